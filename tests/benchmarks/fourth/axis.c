/* A servo axis and its drive, in fixed steps of about 12 us.
 *
 * The mechanics: a rigid axis or two masses with a spring and a gap; dry friction as a set-valued law, implicit in
 * every step (J. J. Moreau's time stepping), or bristles. The motor: its windings in dq by Heun's rule with a PI
 * controller that acts one period late, or a current loop of first order. Three controllers, three speed estimates.
 * Units are SI; an axis in metres has N for N m and m for rad.
 */
#include <math.h>
#include <string.h>

#define PI 3.14159265358979323846
#define COLUMNS 14
#define LONGEST_MEAN 64 /* samples */
#define DWELL_GROWTH 0.5 /* 1/s, of the friction that grows at rest */
#define DWELL_LOSS 0.02  /* s, in which it is lost in motion */

/* Names, in the order in which Python hands the values over; Python reads them from `parameter_names`. */
#define PARAMETERS(X)                                                                                                 \
    X(J) X(F_c) X(F_v) X(K_t) X(p) X(R) X(L_d) X(L_q) X(psi_f)                                                        \
    X(stribeck_force) X(stribeck_speed) X(stribeck_power) X(viscous_asymmetry) X(constant_load) X(load_friction)      \
    X(position_friction) X(position_phase) X(quadratic_drag) X(drag_gain) X(drag_power)                               \
    X(warm_F_v) X(warm_F_c) X(warm_time) X(unbalance) X(unbalance_phase)                                              \
    X(cogging_0) X(cogging_1) X(cogging_order_0) X(cogging_order_1) X(cogging_phase_0) X(cogging_phase_1)             \
    X(ripple) X(ripple_order) X(ripple_phase) X(torque_saturation)                                                    \
    X(load_inertia) X(stiffness) X(damping) X(gap) X(bristle_length) X(bristle_time)                                  \
    X(offset_alpha) X(offset_beta) X(gain_cos) X(gain_sin) X(eccentricity) X(eccentricity_phase)                      \
    X(dead_voltage) X(dead_current)                                                                                   \
    X(spot_force) X(spot_centre) X(spot_width) X(seal_force) X(seal_length)                                           \
    X(push_force) X(push_start) X(push_duration) X(slow_load) X(slow_load_frequency) X(slow_load_phase)               \
    X(dwell_force) X(dwell_speed) X(mesh_force) X(mesh_order) X(mesh_phase)                                           \
    X(T_control) X(speed_divider) X(substeps) X(structure) X(estimator) X(windings) X(speed_only)                     \
    X(K_v) X(K_p) X(K_i) X(K_d) X(filter_time) X(mean_length) X(observer_bandwidth) X(J_control)                      \
    X(acceleration_feedforward) X(coulomb_feedforward) X(viscous_feedforward) X(i_max)                                \
    X(current_time) X(current_gain) X(current_reset) X(u_max) X(encoder_step)

#define AS_FIELD(name) double name;
#define AS_TEXT(name) #name " "
typedef struct { PARAMETERS(AS_FIELD) } parameters;
const char *parameter_names(void) { return PARAMETERS(AS_TEXT); }

enum { CASCADE, PID, STATE_FEEDBACK };                 /* structure */
enum { FILTERED_DIFFERENCE, SLIDING_MEAN, OBSERVER };  /* estimator */
enum { THETA, OMEGA, MEASURED_ANGLE, SPEED_ESTIMATE, I_Q, I_Q_COMMAND, IDEAL_TORQUE, DRY, ADDED, ACCELERATION, I_D,
       U_D, U_Q, TORQUE };                             /* columns of the table */

typedef struct { double d, q; } dq;

typedef struct {
    double theta, omega, theta_load, omega_load;
    double bristle, seal, dwell; /* 1: a bristle fully bent, a seal fully turned, a rest long enough */
    double t;                    /* s */
    dq i, u;
} axis;

typedef struct {
    double angle, last_angle, speed, command, integral;
    double window[LONGEST_MEAN], window_sum;
    int place;
    double seen_angle, seen_speed, seen_acceleration; /* of the observer */
    dq current_integral, next_u;
} drive;

typedef struct { double ideal, torque, dry, added, acceleration; } balance;

static double direction(double x) { return (x > 0) - (x < 0); }
static double clipped(double x, double limit) { return x > limit ? limit : (x < -limit ? -limit : x); }

/* What the current sensors add: an offset of each phase, unequal gains. */
static dq sensor_error(const parameters *m, double angle, dq i) {
    double c = cos(angle), s = sin(angle), a = m->offset_alpha, b = m->offset_beta;
    if (m->gain_cos != 0 || m->gain_sin != 0) {
        double i_a = c * i.d - s * i.q, i_b = s * i.d + c * i.q;
        a += m->gain_cos * i_a + m->gain_sin * i_b;
        b += m->gain_sin * i_a - m->gain_cos * i_b;
    }
    return (dq){c * a + s * b, -s * a + c * b};
}

static void estimate_speed(const parameters *m, drive *c, double T) {
    double slope = (c->angle - c->last_angle) / T;
    c->last_angle = c->angle;
    if (m->estimator == FILTERED_DIFFERENCE) c->speed += (T / (T + m->filter_time)) * (slope - c->speed);
    else if (m->estimator == SLIDING_MEAN) {
        int length = (int)m->mean_length;
        c->window_sum += slope - c->window[c->place];
        c->window[c->place] = slope;
        c->place = (c->place + 1) % length;
        c->speed = c->window_sum / length;
    } else {
        double L = m->observer_bandwidth, e = c->angle - c->seen_angle;
        c->seen_angle += T * (c->seen_speed + 3 * L * e);
        c->seen_speed += T * (m->K_t * c->command / m->J_control + c->seen_acceleration + 3 * L * L * e);
        c->seen_acceleration += T * L * L * L * e;
        c->speed = c->seen_speed;
    }
}

static double feedforward(const parameters *m, double speed, double acceleration) {
    double width = 1e-9 + m->observer_bandwidth * m->encoder_step * 50;
    return m->acceleration_feedforward * m->J_control / m->K_t * acceleration +
           (m->coulomb_feedforward * tanh(speed / width) + m->viscous_feedforward * speed) / m->K_t;
}

/* The current command; the integral stands while the command is at its limit. */
static void command_current(const parameters *m, drive *c, double T, double angle, double speed, double acceleration) {
    double e = angle - c->angle, added = feedforward(m, speed, acceleration), wanted, error = e;
    if (m->structure == CASCADE) {
        error = speed + (m->speed_only ? 0 : m->K_v * e) - c->speed;
        wanted = m->K_p * error + c->integral + added;
    } else if (m->structure == PID) {
        wanted = m->K_p * e + c->integral + m->K_d * (speed - c->speed) + added;
    } else {
        double load = m->estimator == OBSERVER ? c->seen_acceleration * m->J_control / m->K_t : 0;
        wanted = m->K_p * e + m->K_d * (speed - c->speed) + added - load + (m->estimator == OBSERVER ? 0 : c->integral);
    }
    c->command = clipped(wanted, m->i_max);
    if (c->command == wanted) c->integral += T * m->K_i * error;
}

/* PI control of both currents, decoupled; what it computes acts in the next period. */
static void control_current(const parameters *m, drive *c, dq measured) {
    double e_d = -measured.d, e_q = c->command - measured.q, electric = m->p * c->speed;
    dq u = {m->current_gain * e_d + c->current_integral.d - electric * m->L_q * measured.q,
            m->current_gain * e_q + c->current_integral.q + electric * (m->L_d * measured.d + m->psi_f)};
    double size = sqrt(u.d * u.d + u.q * u.q), scale = size > m->u_max ? m->u_max / size : 1;
    c->next_u = (dq){u.d * scale, u.q * scale};
    if (scale == 1) {
        c->current_integral.d += m->T_control / m->current_reset * m->current_gain * e_d;
        c->current_integral.q += m->T_control / m->current_reset * m->current_gain * e_q;
    }
}

/* The voltage that the inverter's dead time takes away. */
static dq dead_time(const parameters *m, double angle, dq i) {
    if (m->dead_voltage <= 0) return (dq){0, 0};
    double c = cos(angle), s = sin(angle), alpha = c * i.d - s * i.q, beta = s * i.d + c * i.q;
    double f_a = clipped(alpha / m->dead_current, 1);
    double f_b = clipped((-0.5 * alpha + 0.8660254037844386 * beta) / m->dead_current, 1);
    double f_c = clipped((-0.5 * alpha - 0.8660254037844386 * beta) / m->dead_current, 1);
    double u_alpha = m->dead_voltage * (2 * f_a - f_b - f_c) / 3;
    double u_beta = m->dead_voltage * (f_b - f_c) * 0.5773502691896258;
    return (dq){c * u_alpha + s * u_beta, -s * u_alpha + c * u_beta};
}

static dq slope_of_current(const parameters *m, dq u, dq lost, dq i, double electric) {
    return (dq){(u.d - lost.d - m->R * i.d + electric * m->L_q * i.q) / m->L_d,
                (u.q - lost.q - m->R * i.q - electric * (m->L_d * i.d + m->psi_f)) / m->L_q};
}

/* One step of the currents. Returns the torque of a motor without faults; `i_q` is the mean current of the step. */
static double step_currents(const parameters *m, axis *y, double command, double dt, double *i_q) {
    if (m->windings) {
        double electric = m->p * y->omega;
        dq lost = dead_time(m, m->p * y->theta, y->i), start = slope_of_current(m, y->u, lost, y->i, electric);
        dq ahead = {y->i.d + dt * start.d, y->i.q + dt * start.q};
        dq end = slope_of_current(m, y->u, lost, ahead, electric);
        double i_d = y->i.d + 0.25 * dt * (start.d + end.d);
        *i_q = y->i.q + 0.25 * dt * (start.q + end.q);
        y->i.d += 0.5 * dt * (start.d + end.d);
        y->i.q += 0.5 * dt * (start.q + end.q);
        return 1.5 * m->p * (m->psi_f * *i_q + (m->L_d - m->L_q) * i_d * *i_q);
    }
    double next = m->current_time > 0 ? command + (y->i.q - command) * exp(-dt / m->current_time) : command;
    *i_q = 0.5 * (y->i.q + next);
    y->i.q = next;
    if (m->offset_alpha != 0 || m->offset_beta != 0 || m->gain_cos != 0 || m->gain_sin != 0)
        *i_q -= sensor_error(m, m->p * y->theta, (dq){0, *i_q}).q;
    return m->K_t * *i_q;
}

static double faulty_torque(const parameters *m, const axis *y, double ideal, double i_q) {
    double torque = ideal;
    if (m->ripple != 0) torque += ideal * m->ripple * sin(m->ripple_order * m->p * y->theta + m->ripple_phase);
    if (m->torque_saturation != 0) torque -= m->torque_saturation * fabs(i_q) * ideal;
    return torque;
}

static double warmth(const parameters *m, double t) { return m->warm_time > 0 ? 1 - exp(-t / m->warm_time) : 0; }

/* Torque that opposes the motor beside inertia, dry and viscous friction and is no dry friction itself. */
static double added_load(const parameters *m, axis *y, double outside, double dt) {
    double w = y->omega, speed = fabs(w), sign = direction(w), theta = y->theta, T = 0;
    T += m->constant_load;
    T += m->viscous_asymmetry * speed;
    T += m->quadratic_drag * w * speed;
    if (m->drag_gain != 0) T += m->drag_gain * pow(speed, m->drag_power) * sign;
    if (m->unbalance != 0) T += m->unbalance * sin(theta + m->unbalance_phase);
    if (m->cogging_0 != 0) T += m->cogging_0 * sin(m->cogging_order_0 * theta + m->cogging_phase_0);
    if (m->cogging_1 != 0) T += m->cogging_1 * sin(m->cogging_order_1 * theta + m->cogging_phase_1);
    if (m->mesh_force != 0) T += m->mesh_force * sin(m->mesh_order * theta + m->mesh_phase);
    if (m->push_force != 0 && y->t > m->push_start && y->t < m->push_start + m->push_duration) {
        double u = sin(PI * (y->t - m->push_start) / m->push_duration);
        T += m->push_force * u * u;
    }
    if (m->slow_load != 0) T += m->slow_load * sin(2 * PI * m->slow_load_frequency * y->t + m->slow_load_phase);
    T += outside;
    T += warmth(m, y->t) * m->warm_F_v * w;
    if (m->seal_force != 0) {
        y->seal = sign + (y->seal - sign) * exp(-speed * dt / m->seal_length);
        T += m->seal_force * y->seal;
    }
    return T;
}

/* Level of dry friction, F_c and what raises it; never below zero. */
static double dry_level(const parameters *m, const axis *y, double torque) {
    double more = 0;
    if (m->stribeck_force != 0)
        more += m->stribeck_force * exp(-pow(fabs(y->omega) / m->stribeck_speed, m->stribeck_power));
    more += m->load_friction * fabs(torque);
    if (m->position_friction != 0) more += m->position_friction * sin(y->theta + m->position_phase);
    more += warmth(m, y->t) * m->warm_F_c;
    if (m->spot_force != 0) {
        double u = (y->theta - m->spot_centre) / m->spot_width;
        more += m->spot_force * exp(-0.5 * u * u);
    }
    more += m->dwell_force * y->dwell;
    return fmax(m->F_c + more, 0);
}

static double spring_torque(const parameters *m, const axis *y) {
    double twist = y->theta - y->theta_load;
    if (m->gap <= 0) return m->stiffness * twist + m->damping * (y->omega - y->omega_load);
    double half = m->gap / 2, e = twist > half ? twist - half : (twist < -half ? twist + half : 0);
    return m->stiffness * e + (e != 0 ? m->damping * (y->omega - y->omega_load) : 0);
}

/* Speed after one step under the driving torque and dry friction of this level; `friction` is what acted. */
static double step_speed(const parameters *m, axis *y, double driving, double level, double J, double dt,
                         double *friction) {
    if (m->bristle_length > 0) {
        double sign = direction(y->omega);
        double bent = sign + (y->bristle - sign) * exp(-fabs(y->omega) * dt / m->bristle_length);
        *friction = level * (bent + m->bristle_time * ((bent - y->bristle) / dt));
        y->bristle = bent;
        return y->omega + dt * (driving - *friction) / J;
    }
    double free = y->omega + dt * driving / J, limit = dt * level / J;
    if (fabs(free) <= limit) {
        *friction = free * J / dt;
        return 0;
    }
    *friction = free > 0 ? level : -level;
    return free - (free > 0 ? limit : -limit);
}

/* One step of the mechanics; the balance says what is dry friction of level F_c and what is more than that. */
static balance step_axis(const parameters *m, axis *y, double command, double outside, double dt) {
    double i_q, friction, spring = 0, ideal = step_currents(m, y, command, dt, &i_q);
    double torque = faulty_torque(m, y, ideal, i_q), added = added_load(m, y, outside, dt);
    double level = dry_level(m, y, torque), viscous = m->F_v * y->omega, before = direction(y->omega);
    int two_masses = m->load_inertia > 0;
    if (two_masses) spring = spring_torque(m, y);
    double driving = torque - viscous - added - spring, J = two_masses ? m->J - m->load_inertia : m->J;
    double omega = step_speed(m, y, driving, level, J, dt, &friction);
    double dry = m->bristle_length > 0 ? m->F_c * before : friction * (level > 0 ? m->F_c / level : 0);
    added += friction - (m->bristle_length > 0 ? level * before : dry);
    double acceleration = (omega - y->omega) / dt;
    y->theta += dt * 0.5 * (y->omega + omega);
    y->omega = omega;
    if (fabs(omega) < m->dwell_speed) y->dwell += dt * DWELL_GROWTH * (1 - y->dwell);
    else y->dwell -= dt * y->dwell / DWELL_LOSS;
    if (two_masses) {
        double omega_load = y->omega_load + dt * spring / m->load_inertia;
        double acceleration_load = (omega_load - y->omega_load) / dt;
        y->theta_load += dt * 0.5 * (y->omega_load + omega_load);
        y->omega_load = omega_load;
        added += m->load_inertia * (acceleration_load - acceleration);
    }
    y->t += dt;
    return (balance){ideal, torque, dry, -(torque - ideal) + added, acceleration};
}

static void read_encoder(const parameters *m, const axis *y, drive *c, double noise, int first) {
    double angle = y->theta + m->eccentricity * sin(y->theta + m->eccentricity_phase) + noise;
    c->angle = floor(angle / m->encoder_step) * m->encoder_step;
    if (first) c->last_angle = c->seen_angle = c->angle;
}

static dq measure_current(const parameters *m, const axis *y, double noise_d, double noise_q) {
    if (!m->windings) return (dq){noise_d, y->i.q + noise_q};
    dq error = sensor_error(m, m->p * y->theta, y->i);
    return (dq){y->i.d + error.d + noise_d, y->i.q + error.q + noise_q};
}

/* The drive over `n` samples of the speed controller; 0, or 1 where it runs away.
 *
 * Reference: angle, speed, acceleration. Noise: of i_q (n) and then of i_d (n), of the encoder, of the load. Table: n
 * rows of COLUMNS. */
int run(const parameters *m, long n, const double *angle, const double *speed, const double *acceleration,
        const double *current_noise, const double *angle_noise, const double *load, double *table) {
    int divider = (int)m->speed_divider, substeps = (int)m->substeps;
    double dt = m->T_control / substeps, T = m->T_control * divider;
    axis y = {.theta = angle[0], .theta_load = angle[0]};
    drive c = {0};
    for (long k = 0; k < n; k++) {
        double *row = table + k * COLUMNS;
        row[THETA] = y.theta;
        row[OMEGA] = y.omega;
        for (int period = 0; period < divider; period++) {
            dq measured = measure_current(m, &y, current_noise[n + k], current_noise[k]);
            if (period == 0) {
                read_encoder(m, &y, &c, angle_noise[k], k == 0);
                estimate_speed(m, &c, T);
                command_current(m, &c, T, angle[k], speed[k], acceleration[k]);
            }
            if (m->windings) {
                y.u = c.next_u;
                control_current(m, &c, measured);
            }
            for (int step = 0; step < substeps; step++) {
                balance now = step_axis(m, &y, c.command, load[k], dt);
                if (period > 0 || step > 0) continue;
                double logged[] = {row[THETA], row[OMEGA], c.angle, c.speed, measured.q, c.command, now.ideal, now.dry,
                                   now.added, now.acceleration, measured.d, y.u.d, y.u.q, now.torque};
                memcpy(row, logged, sizeof logged);
            }
        }
        if (!(fabs(y.theta) < 1e9)) return 1;
    }
    return 0;
}
