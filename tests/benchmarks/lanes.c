/* How fast a batch could be: LANES drives side by side, one straight loop body that gcc vectorises.
 *
 * An estimate of the limit, not a simulation: the base drive with encoder, cascade and Runge-Kutta step, but the
 * speed that meets zero is set to zero without splitting the step, the voltage limit is a circle, there is no
 * noise, and nothing is logged.
 */
#include <math.h>
#include <stdint.h>

#ifndef LANES
#define LANES 16
#endif

typedef struct { double i_d, i_q, omega, theta; } state;

static inline double cos_small(double x) {
    double y = x * x;
    return 1.0 + y * (-1.0 / 2.0 + y * (1.0 / 24.0 + y * (-1.0 / 720.0 + y * (1.0 / 40320.0))));
}

static inline double sin_small(double x) {
    double y = x * x;
    return x * (1.0 + y * (-1.0 / 6.0 + y * (1.0 / 120.0 + y * (-1.0 / 5040.0 + y * (1.0 / 362880.0)))));
}

/* One row of `x` a quantity, one column a drive. Parameters vary in J, F_c and F_v, the rest is shared. */
enum { I_D, I_Q, OMEGA, THETA, INT_D, INT_Q, INT_S, THETA_LAST, OMEGA_HAT, I_Q_REF, U_D, U_Q, ANGLE, ROWS };

static inline state slope(state y, double u_d_held, double u_q_held, double angle_held, double dir, double R, double L,
                          double p, double psi, double per_L, double per_J, double F_c, double F_v) {
    double a = angle_held - p * y.theta, c = cos_small(a), s = sin_small(a);
    double u_d = c * u_d_held - s * u_q_held, u_q = s * u_d_held + c * u_q_held;
    state d = {(u_d - (R * y.i_d - p * y.omega * L * y.i_q)) * per_L,
               (u_q - (R * y.i_q + p * y.omega * (L * y.i_d + psi))) * per_L,
               (1.5 * p * psi * y.i_q - F_c * dir - F_v * y.omega) * per_J, y.omega};
    return d;
}

static inline state add(state y, double h, state k) {
    state out = {y.i_d + h * k.i_d, y.i_q + h * k.i_q, y.omega + h * k.omega, y.theta + h * k.theta};
    return out;
}

void run_lanes(int64_t n, double x[ROWS][LANES], const double J[LANES], const double F_c[LANES],
               const double F_v[LANES], const double *plant, const double *gains, const double *omega_ref) {
    const double R = plant[0], L = plant[2], p = plant[3], psi = plant[4], u_dc = plant[6], T = plant[7];
    const double counts = plant[8] / (2.0 * 3.14159265358979323846), turn = 1.0 / counts, per_L = 1.0 / L;
    const int64_t divider = (int64_t)plant[11];
    const double T_s = T * divider, h = T, limit = u_dc * u_dc / 3.0, i_max = gains[11];
    const double K = gains[2], b = gains[3], K_s = gains[4], b_s = gains[5], a_speed = gains[6];
    for (int64_t k = 0; k < n; k++) {
        const int speed_tick = k % divider == 0;
        const double wanted_speed = omega_ref[k / divider];
        for (int l = 0; l < LANES; l++) {
            state y = {x[I_D][l], x[I_Q][l], x[OMEGA][l], x[THETA][l]};
            double theta_m = floor(y.theta * counts + 0.5) * turn;
            double a = p * (y.theta - theta_m), c = cos_small(a), s = sin_small(a);
            double i_d_m = c * y.i_d - s * y.i_q, i_q_m = s * y.i_d + c * y.i_q;
            double omega_hat = x[OMEGA_HAT][l], i_q_ref = x[I_Q_REF][l];
            if (speed_tick) {
                omega_hat += a_speed * ((theta_m - x[THETA_LAST][l]) / T_s - omega_hat);
                double e = wanted_speed - omega_hat, w = K_s * e + x[INT_S][l];
                i_q_ref = w > i_max ? i_max : w;
                i_q_ref = i_q_ref < -i_max ? -i_max : i_q_ref;
                x[INT_S][l] += b_s * (K_s * e + i_q_ref - w);
                x[THETA_LAST][l] = theta_m;
            }
            double u_d = -K * i_d_m + x[INT_D][l] - p * omega_hat * L * i_q_m;
            double u_q = K * (i_q_ref - i_q_m) + x[INT_Q][l] + p * omega_hat * (L * i_d_m + psi);
            double size = u_d * u_d + u_q * u_q;
            double scale = size > limit ? sqrt(limit / size) : 1.0;
            x[INT_D][l] += b * (-K * i_d_m + (scale - 1.0) * u_d);
            x[INT_Q][l] += b * (K * (i_q_ref - i_q_m) + (scale - 1.0) * u_q);
            double v_d = x[U_D][l], v_q = x[U_Q][l], angle = x[ANGLE][l];
            x[U_D][l] = u_d * scale, x[U_Q][l] = u_q * scale, x[ANGLE][l] = p * (theta_m + 1.5 * T * omega_hat);
            double push = 1.5 * p * psi * y.i_q, F = F_c[l], G = F_v[l], per_J = 1.0 / J[l];
            double rest = push > F ? 1.0 : push < -F ? -1.0 : push / F;
            double dir = y.omega > 0.0 ? 1.0 : y.omega < 0.0 ? -1.0 : rest;
            state k1 = slope(y, v_d, v_q, angle, dir, R, L, p, psi, per_L, per_J, F, G);
            state k2 = slope(add(y, 0.5 * h, k1), v_d, v_q, angle, dir, R, L, p, psi, per_L, per_J, F, G);
            state k3 = slope(add(y, 0.5 * h, k2), v_d, v_q, angle, dir, R, L, p, psi, per_L, per_J, F, G);
            state k4 = slope(add(y, h, k3), v_d, v_q, angle, dir, R, L, p, psi, per_L, per_J, F, G);
            state z = add(add(add(add(y, h / 6.0, k1), h / 3.0, k2), h / 3.0, k3), h / 6.0, k4);
            z.omega = z.omega * y.omega < 0.0 ? 0.0 : z.omega;
            x[I_D][l] = z.i_d, x[I_Q][l] = z.i_q, x[OMEGA][l] = z.omega, x[THETA][l] = z.theta;
            x[OMEGA_HAT][l] = omega_hat, x[I_Q_REF][l] = i_q_ref;
        }
    }
}
