/* A day on one axis: motion of two speeds and rests, friction that falls as the axis warms up, a noisy current, an
 * encoder read within one turn. Everything is in double; the tracker takes it in its own precision. */
#include <math.h>
#include <stdint.h>
#include AXIS

#define PI 3.14159265358979323846
#define CYCLE 60000 /* samples of 1 ms: 50 s of motion, 10 s of rest */

static uint64_t seed = 88172645463325252u;

static double uniform(void) {
    seed ^= seed << 13;
    seed ^= seed >> 7;
    seed ^= seed << 17;
    return (double)(seed >> 11) / 9007199254740992.0;
}

static double speed_at(long k) { /* rad/s, at sample k of a cycle */
    double t = 1e-3 * (double)k, rise = fmin(1.0, fmin(t, 50.0 - t));
    if (k < 0 || rise <= 0.0) return 0.0;
    return rise * (20.0 + 120.0 * sin(0.5 * PI * t));
}

/* Write F_c, F_v, their deviations and the true values, once every `every` samples. */
void day(long n, long every, const double *axis, double *out) {
    const double J = axis[0], K_t = axis[1], F_c0 = axis[2], F_v0 = axis[3], count = axis[4], noise = axis[5];
    seed_motor_tracker_t self;
    double theta = 0.0, before = 0.0;
    seed_motor_tracker_init(&self);
    for (long k = 0; k < n; k++) {
        long at = k % CYCLE;
        double omega = speed_at(at), warm = 1.0 - 0.4 * (1.0 - exp(-1e-3 * (double)k / 7200.0));
        double F_c = F_c0 * warm, F_v = F_v0 * warm, alpha = (speed_at(at + 1) - speed_at(at - 1)) / 2e-3;
        double dry = omega > 0.0 ? F_c : omega < 0.0 ? -F_c : 0.0;
        double wave = uniform() + uniform() + uniform() + uniform() - 2.0; /* its variance is a third */
        double i_q = (J * alpha + dry + F_v * omega) / K_t + noise * sqrt(3.0) * wave;
        theta = fmod(theta + 0.5e-3 * (omega + before) + 2.0 * PI, 2.0 * PI);
        before = omega;
        seed_motor_tracker_update(
            &self, (NUMBER)1e-3, (NUMBER)(count * floor(theta / count)), (NUMBER)0, (NUMBER)i_q, (NUMBER)0);
        if (k % every == every - 1) {
            const double row[6] = {self.F_c, self.F_v, self.sd_F_c, self.sd_F_v, F_c, F_v};
            for (int c = 0; c < 6; c++) *out++ = row[c];
        }
    }
}
