/* The sampled drive in C: the loop of pmsm_ctrl/kernels/drive_template.py with its effects written out.
 *
 * The yardstick of the benchmark. Same algorithm, same order of operations, same arrays; -DSIX adds four
 * effects to Coulomb and viscous friction, -DNOISE takes the current noise from numpy's own generator.
 */
#include <math.h>
#include <stdint.h>

#define PI 3.14159265358979323846

typedef struct { double i_d, i_q, omega, theta; } state;
typedef struct { double u_d, u_q, angle, T_load; } held_input;
typedef struct { double R, L_d, L_q, p, psi_f, J; } machine_data;

/* numpy's bitgen_t, numpy/random/bitgen.h */
typedef struct {
    void *state;
    uint64_t (*next_uint64)(void *);
    uint32_t (*next_uint32)(void *);
    double (*next_double)(void *);
    uint64_t (*next_raw)(void *);
} bitgen;
extern double random_standard_normal(bitgen *);

static inline double cos_small(double x) {
    double y = x * x;
    return 1.0 + y * (-1.0 / 2.0 + y * (1.0 / 24.0 + y * (-1.0 / 720.0 + y * (1.0 / 40320.0))));
}

static inline double sin_small(double x) {
    double y = x * x;
    return x * (1.0 + y * (-1.0 / 6.0 + y * (1.0 / 120.0 + y * (-1.0 / 5040.0 + y * (1.0 / 362880.0)))));
}

static inline double max2(double a, double b) { return a > b ? a : b; }
static inline double min2(double a, double b) { return a < b ? a : b; }

static double hexagon_scale(double u_d, double u_q, double angle, double u_dc) {
    if (3.0 * (u_d * u_d + u_q * u_q) <= u_dc * u_dc) return 1.0;
    double c = cos(angle), s = sin(angle);
    double alpha = c * u_d - s * u_q, beta = s * u_d + c * u_q;
    double half = sqrt(3.0) / 2.0;
    double a = alpha, b = -0.5 * alpha + half * beta, d = -0.5 * alpha - half * beta;
    double span = max2(max2(a, b), d) - min2(min2(a, b), d);
    return span <= u_dc ? 1.0 : u_dc / span;
}

static inline double quantise(double theta, double counts) {
    if (counts == 0.0) return theta;
    return floor(theta * counts / (2.0 * PI) + 0.5) * (2.0 * PI) / counts;
}

/* Torque left for the shaft. Effects in the order of the parameters. */
static inline double shaft_torque(state y, double direction, double T_load, const machine_data *m, const double *e) {
    double torque = 1.5 * m->p * (m->psi_f * y.i_q + (m->L_d - m->L_q) * y.i_d * y.i_q);
    double opposing = T_load;
    opposing += e[0] * direction;                                                  /* coulomb */
    opposing += e[1] * y.omega;                                                    /* viscous */
#ifdef SIX
    opposing += e[2] * exp(-pow(fabs(y.omega / e[3]), e[4])) * direction;          /* stribeck */
    opposing += e[5] * y.omega * fabs(y.omega);                                    /* quadratic_drag */
    opposing += e[6] * sin(e[8] * y.theta) + e[7] * cos(e[8] * y.theta);           /* cogging */
    opposing += e[9] * sin(y.theta) + e[10] * cos(y.theta);                        /* unbalance */
#endif
    return torque - opposing;
}

static inline state derivative(state y, double direction, const held_input *u, const machine_data *m, const double *e) {
    double angle = u->angle - m->p * y.theta;
    double c = cos_small(angle), s = sin_small(angle);
    double u_d = c * u->u_d - s * u->u_q, u_q = s * u->u_d + c * u->u_q;
    state d;
    d.i_d = (u_d - (m->R * y.i_d - m->p * y.omega * m->L_q * y.i_q)) * (1.0 / m->L_d);
    d.i_q = (u_q - (m->R * y.i_q + m->p * y.omega * (m->L_d * y.i_d + m->psi_f))) * (1.0 / m->L_q);
    d.omega = direction == 0.0 ? 0.0 : shaft_torque(y, direction, u->T_load, m, e) * (1.0 / m->J);
    d.theta = y.omega;
    return d;
}

static inline state advance(state y, double h, state k) {
    state out = {y.i_d + h * k.i_d, y.i_q + h * k.i_q, y.omega + h * k.omega, y.theta + h * k.theta};
    return out;
}

static inline state runge_kutta(state y, double h, double direction, const held_input *u, const machine_data *m,
                                const double *e) {
    state a = derivative(y, direction, u, m, e);
    state b = derivative(advance(y, 0.5 * h, a), direction, u, m, e);
    state c = derivative(advance(y, 0.5 * h, b), direction, u, m, e);
    state d = derivative(advance(y, h, c), direction, u, m, e);
    y = advance(y, h / 6.0, a);
    y = advance(y, h / 3.0, b);
    y = advance(y, h / 3.0, c);
    return advance(y, h / 6.0, d);
}

static inline double impending(state y, const held_input *u, const machine_data *m, const double *e) {
    if (shaft_torque(y, 1.0, u->T_load, m, e) > 0.0) return 1.0;
    if (shaft_torque(y, -1.0, u->T_load, m, e) < 0.0) return -1.0;
    return 0.0;
}

/* One plant step with set-valued friction: where the speed meets zero the step is split. */
static inline state step_dry(state y, double h, const held_input *u, const machine_data *m, const double *e) {
    double done = 0.0, trial = h, direction = 0.0;
    int undecided = 1, landing = 0;
    for (int n = 0; n < 16; n++) {
        if (undecided) direction = y.omega > 0.0 ? 1.0 : y.omega < 0.0 ? -1.0 : impending(y, u, m, e);
        state next = runge_kutta(y, trial, direction, u, m, e);
        if (landing) {
            next.omega = 0.0;
        } else if (direction * next.omega < 0.0) {
            undecided = 0;
            if (y.omega == 0.0) {
                direction = 0.0;
            } else {
                trial *= y.omega / (y.omega - next.omega);
                landing = 1;
            }
            continue;
        }
        y = next;
        done += trial;
        if (done >= h * (1.0 - 1e-12)) break;
        trial = h - done;
        undecided = 1, landing = 0;
    }
    return y;
}

/* `plant`, `controller`, `effects`, `inputs` (rows of 6) and `out` (rows of `width`) as in the package. */
int64_t run(int64_t n, int64_t k, double *states, const double *plant, const double *controller,
            const double *effects, const double *inputs, double *out, int64_t width, bitgen *noise) {
    machine_data m = {plant[0], plant[1], plant[2], plant[3], plant[4], plant[5]};
    const double p = m.p, u_dc = plant[6], T = plant[7], counts = plant[8], current_noise = plant[9];
    const int64_t steps = (int64_t)plant[10], divider = (int64_t)plant[11], log_divider = (int64_t)plant[12];
    const int64_t delay = (int64_t)plant[13];
    const double K_c_d = controller[0], b_c_d = controller[1], K_c_q = controller[2], b_c_q = controller[3];
    const double K_s = controller[4], b_s = controller[5], a_speed = controller[6], a_ref = controller[7];
    const double K_v = controller[8], k_omega = controller[9], k_alpha = controller[10], i_max = controller[11];
    const double L_d_hat = controller[12], L_q_hat = controller[13], psi_hat = controller[14];
    state y = {states[0], states[1], states[2], states[3]};
    double I_d = states[4], I_q = states[5], I_s = states[6], theta_last = states[7], omega_hat = states[8];
    double i_q_ref = states[9], i_d_ref = states[10];
    held_input next = {states[11], states[12], states[13], 0.0};
    double omega_filtered = states[14];
    const double h = T / steps, T_s = T * divider;
    int64_t to_speed = (divider - k % divider) % divider, to_log = (log_divider - k % log_divider) % log_divider;
    const double *in = to_speed == 0 ? inputs - 6 : inputs;
    int64_t row = 0;
    double e[11];
    for (int i = 0; i < (int)(sizeof e / sizeof *e); i++) e[i] = effects[i];
    for (int64_t done = 0; done < n; done++, k++, to_speed--, to_log--) {
        double t = k * T;
        if (to_speed == 0) in += 6;
        double T_load = in[5];
        double theta_m = quantise(y.theta, counts);
        double angle = p * (y.theta - theta_m);
        double c = cos_small(angle), s = sin_small(angle);
        double i_d_m = c * y.i_d - s * y.i_q, i_q_m = s * y.i_d + c * y.i_q;
#ifdef NOISE
        if (current_noise > 0.0) {
            i_d_m += current_noise * random_standard_normal(noise);
            i_q_m += current_noise * random_standard_normal(noise);
        }
#else
        (void)noise, (void)current_noise;
#endif
        if (to_speed == 0) {
            to_speed = divider;
            omega_hat += a_speed * ((theta_m - theta_last) / T_s - omega_hat);
            theta_last = theta_m;
            omega_filtered += a_ref * (k_omega * in[1] - omega_filtered);
            double omega_ref = omega_filtered;
            if (K_v > 0.0) omega_ref += K_v * (in[0] - theta_m);
            double error = omega_ref - omega_hat;
            double wanted = K_s * error + I_s + k_alpha * in[2] + in[3];
            i_q_ref = min2(max2(wanted, -i_max), i_max);
            I_s += b_s * (K_s * error + i_q_ref - wanted);
            i_d_ref = in[4];
        }
        double e_d = i_d_ref - i_d_m, e_q = i_q_ref - i_q_m;
        double u_d = K_c_d * e_d + I_d - p * omega_hat * L_q_hat * i_q_m;
        double u_q = K_c_q * e_q + I_q + p * omega_hat * (L_d_hat * i_d_m + psi_hat);
        double angle_command = p * (theta_m + (delay + 0.5) * T * omega_hat);
        double scale = hexagon_scale(u_d, u_q, angle_command, u_dc);
        I_d += b_c_d * (K_c_d * e_d + (scale - 1.0) * u_d);
        I_q += b_c_q * (K_c_q * e_q + (scale - 1.0) * u_q);
        u_d *= scale;
        u_q *= scale;
        if (to_log == 0) {
            to_log = log_divider;
            if (!(isfinite(y.omega) && isfinite(y.i_d) && isfinite(y.i_q))) return -1 - k;
            double values[14] = {t, theta_m, omega_hat, i_d_m, i_q_m, i_d_ref, i_q_ref, u_d, u_q,
                                 in[1], in[0], T_load, y.theta, y.omega};
            for (int i = 0; i < 14; i++) out[row * width + i] = values[i];
            row++;
        }
        held_input now = {u_d, u_q, angle_command, T_load}, held = now;
        if (delay == 1) {
            held = next;
            held.T_load = T_load;
            next = now;
        }
        for (int64_t i = 0; i < steps; i++) y = step_dry(y, h, &held, &m, e);
    }
    double final[15] = {y.i_d, y.i_q, y.omega, y.theta, I_d, I_q, I_s, theta_last, omega_hat, i_q_ref, i_d_ref,
                        next.u_d, next.u_q, next.angle, omega_filtered};
    for (int i = 0; i < 15; i++) states[i] = final[i];
    return row;
}
