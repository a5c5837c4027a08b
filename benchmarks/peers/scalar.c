/* The filters as scalar loops, one run after the other, for `c_.py`. Random numbers: xoshiro256+ and a
   ziggurat of 128 layers (Marsaglia & Tsang 2000; Doornik 2005). */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

static uint64_t s[4];
static double zig_x[129], zig_ratio[128];

static inline uint64_t turn(uint64_t x, int k) { return (x << k) | (x >> (64 - k)); }

static inline uint64_t next(void) {
    uint64_t result = s[0] + s[3], t = s[1] << 17;
    s[2] ^= s[0]; s[3] ^= s[1]; s[1] ^= s[2]; s[0] ^= s[3];
    s[2] ^= t; s[3] = turn(s[3], 45);
    return result;
}

static inline double uniform(void) { return ((next() >> 11) + 0.5) * 0x1p-53; }

void seed(uint64_t n) {
    for (int i = 0; i < 4; i++) {  /* splitmix64 */
        uint64_t z = (n += 0x9e3779b97f4a7c15u);
        z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
        z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
        s[i] = z ^ (z >> 31);
    }
    const double r = 3.442619855899, v = 9.91256303526217e-3;
    double f = exp(-0.5 * r * r);
    zig_x[0] = v / f; zig_x[1] = r; zig_x[128] = 0.0;
    for (int i = 2; i < 128; i++) {
        zig_x[i] = sqrt(-2.0 * log(v / zig_x[i - 1] + f));
        f = exp(-0.5 * zig_x[i] * zig_x[i]);
    }
    for (int i = 0; i < 128; i++) zig_ratio[i] = zig_x[i + 1] / zig_x[i];
}

static double normal(void) {
    for (;;) {
        uint64_t bits = next();
        int i = bits & 127;
        double u = 2.0 * ((bits >> 11) * 0x1p-53) - 1.0;
        if (fabs(u) < zig_ratio[i]) return u * zig_x[i];
        if (i == 0) {
            double x, y;
            do { x = log(uniform()) / 3.442619855899; y = log(uniform()); } while (-2.0 * y < x * x);
            return u < 0.0 ? x - 3.442619855899 : 3.442619855899 - x;
        }
        double x = u * zig_x[i];
        double f0 = exp(-0.5 * (zig_x[i] * zig_x[i] - x * x)), f1 = exp(-0.5 * (zig_x[i + 1] * zig_x[i + 1] - x * x));
        if (f1 + uniform() * (f0 - f1) < 1.0) return x;
    }
}

/* Gamma variate of shape 3 and rate 1. */
static inline double gamma3(void) { return -log(uniform() * uniform() * uniform()); }

/* Weights from log-weights, and their sum's inverse applied. */
static void normalize(double *w, int N) {
    double top = w[0], sum = 0.0;
    for (int i = 1; i < N; i++) if (w[i] > top) top = w[i];
    for (int i = 0; i < N; i++) sum += w[i] = exp(w[i] - top);
    for (int i = 0; i < N; i++) w[i] /= sum;
}

/* Systematic resampling of n rows x (n, N) into y. */
static void resample(const double *w, const double *x, double *y, int n, int N) {
    double u = uniform(), sum = w[0];
    for (int i = 0, j = 0; i < N; i++) {
        while (sum < (i + u) / N && j < N - 1) sum += w[++j];
        for (int c = 0; c < n; c++) y[c * N + i] = x[c * N + j];
    }
}

/* p: x1, w pi, phi1, phi2, phi3, R, rate, switch; steps k (T); z and out (M, T). Gamma noise of shape 3. */
void merwe_pf(const double *p, const double *steps, const double *z, int T, int M, int N, double *out) {
    double *x = malloc(3 * N * sizeof *x), *y = x + N, *w = y + N;
    for (int m = 0; m < M; m++) {
        for (int i = 0; i < N; i++) x[i] = p[0];
        for (int t = 0; t < T; t++) {
            double k = steps[t], drive = 1.0 + sin(p[1] * k), seen = z[m * T + t], mean = 0.0;
            int early = k <= p[7];
            for (int i = 0; i < N; i++) {
                x[i] = drive + p[2] * x[i] + gamma3() / p[6];
                double e = seen - (early ? p[3] * x[i] * x[i] : p[4] * x[i] - 2.0);
                w[i] = -0.5 * e * e / p[5];
            }
            normalize(w, N);
            for (int i = 0; i < N; i++) mean += w[i] * x[i];
            out[m * T + t] = mean;
            resample(w, x, y, 1, N);
            double *swap = x; x = y; y = swap;
        }
    }
    free(x < y ? x : y);
}

/* Unscented particle filter: a UKF per particle, with points of state, process noise and measurement
   noise (alpha 1, beta 0, kappa 2). */
void merwe_upf(const double *p, const double *steps, const double *z, int T, int M, int N, double *out) {
    double *x = malloc(5 * N * sizeof *x), *P = x + N, *y = P + N, *log_w = y + 2 * N;
    double q_mean = 3.0 / p[6], q_var = 3.0 / (p[6] * p[6]);
    double pushed = sqrt(5.0 * q_var), noisy = sqrt(5.0 * p[5]);
    for (int m = 0; m < M; m++) {
        for (int i = 0; i < N; i++) { x[i] = p[0]; P[i] = 0.0; }
        for (int t = 0; t < T; t++) {
            double k = steps[t], drive = 1.0 + sin(p[1] * k), seen = z[m * T + t], mean = 0.0;
            int early = k <= p[7];
            for (int i = 0; i < N; i++) {
                double old = x[i], mu = drive + p[2] * old + q_mean, V = p[2] * p[2] * P[i] + q_var;
                double moved = p[2] * sqrt(5.0 * P[i]), h[7], noise[7] = {0, 0, 0, 0, 0, noisy, -noisy};
                double points[7] = {mu, mu + moved, mu - moved, mu + pushed, mu - pushed, mu, mu};
                double zm = 0.0, S = 0.0, C = 0.0;
                for (int j = 0; j < 7; j++) {
                    double a = points[j], weight = j ? 0.1 : 0.4;
                    h[j] = (early ? p[3] * a * a : p[4] * a - 2.0) + noise[j];
                    zm += weight * h[j];
                }
                for (int j = 0; j < 7; j++) {
                    double weight = j ? 0.1 : 0.4, e = h[j] - zm;
                    S += weight * e * e; C += weight * (points[j] - mu) * e;
                }
                double K = C / S, post = mu + K * (seen - zm), U = V - K * K * S, e = normal();
                x[i] = post + sqrt(U) * e; P[i] = U;
                double v = x[i] - drive - p[2] * old;
                double r = seen - (early ? p[3] * x[i] * x[i] : p[4] * x[i] - 2.0);
                log_w[i] = v > 0.0 ? 2.0 * log(v) - p[6] * v - 0.5 * r * r / p[5] + 0.5 * e * e + 0.5 * log(U) : -1e300;
            }
            normalize(log_w, N);
            for (int i = 0; i < N; i++) mean += log_w[i] * x[i];
            out[m * T + t] = mean;
            resample(log_w, x, y, 2, N);
            memcpy(x, y, 2 * N * sizeof *x);
        }
    }
    free(x);
}

/* Log-posterior of the state x of a particle that comes from `old`: likelihood times gamma density of shape 3. */
static inline double merwe_log_posterior(const double *p, double x, double old, double drive, double seen, int early) {
    double v = x - drive - p[2] * old;
    double r = seen - (early ? p[3] * x * x : p[4] * x - 2.0);
    return v > 0.0 ? 2.0 * log(v) - p[6] * v - 0.5 * r * r / p[5] : -INFINITY;
}

/* Hybrid differential evolution particle filter: a UKF per particle, G generations of mutation (F), crossover
   (CR) and annealed selection (T0, rho) in place of resampling, the best point of each slot weighted by its
   posterior. e: F, CR, T0, rho. A trial that took nothing from its mutant is its parent, and costs nothing. */
void merwe_hdepf(const double *p, const double *e, const double *steps, const double *z, int T, int M, int N, int G,
                 double *out) {
    double *memory = malloc(8 * N * sizeof *memory);
    double *origin = memory, *P = memory + N, *fit = memory + 2 * N, *best = memory + 3 * N, *best_fit = memory + 4 * N;
    double *w = memory + 5 * N;
    double q_mean = 3.0 / p[6], q_var = 3.0 / (p[6] * p[6]);
    double pushed = sqrt(5.0 * q_var), noisy = sqrt(5.0 * p[5]);
    for (int m = 0; m < M; m++) {
        for (int i = 0; i < N; i++) { origin[i] = p[0]; P[i] = 0.0; }
        for (int t = 0; t < T; t++) {
            double k = steps[t], drive = 1.0 + sin(p[1] * k), seen = z[m * T + t];
            double *x = memory + 6 * N, *next_x = memory + 7 * N;
            int early = k <= p[7];
            for (int i = 0; i < N; i++) {
                double old = origin[i], mu = drive + p[2] * old + q_mean, V = p[2] * p[2] * P[i] + q_var;
                double moved = p[2] * sqrt(5.0 * P[i]), h[7], noise[7] = {0, 0, 0, 0, 0, noisy, -noisy};
                double points[7] = {mu, mu + moved, mu - moved, mu + pushed, mu - pushed, mu, mu};
                double zm = 0.0, S = 0.0, C = 0.0;
                for (int j = 0; j < 7; j++) {
                    double a = points[j], weight = j ? 0.1 : 0.4;
                    h[j] = (early ? p[3] * a * a : p[4] * a - 2.0) + noise[j];
                    zm += weight * h[j];
                }
                for (int j = 0; j < 7; j++) {
                    double weight = j ? 0.1 : 0.4, d = h[j] - zm;
                    S += weight * d * d;
                    C += weight * (points[j] - mu) * d;
                }
                double K = C / S;
                P[i] = V - K * K * S;
                x[i] = best[i] = mu + K * (seen - zm) + sqrt(P[i]) * normal();
                fit[i] = best_fit[i] = merwe_log_posterior(p, x[i], old, drive, seen, early);
            }
            double temperature = e[2];
            for (int g = 0; g < G; g++) {
                for (int i = 0; i < N; i++) {
                    next_x[i] = x[i];
                    if (uniform() > e[1]) continue;
                    int a = 1 + (int)(uniform() * (N - 1)), b = 1 + (int)(uniform() * (N - 2));
                    b += b >= a;
                    a += i;
                    b += i;
                    if (a >= N) a -= N;
                    if (b >= N) b -= N;
                    double trial = x[i] + e[0] * (x[a] - x[b]);
                    double trial_fit = merwe_log_posterior(p, trial, origin[i], drive, seen, early);
                    double gain = trial_fit - fit[i];
                    if (gain > 0.0 || gain > temperature * log(uniform())) {
                        next_x[i] = trial;
                        fit[i] = trial_fit;
                        if (trial_fit > best_fit[i]) { best[i] = trial; best_fit[i] = trial_fit; }
                    }
                }
                double *swap = x; x = next_x; next_x = swap;
                temperature *= e[3];
            }
            memcpy(w, best_fit, N * sizeof *w);
            normalize(w, N);
            double mean = 0.0;
            for (int i = 0; i < N; i++) { mean += w[i] * best[i]; origin[i] = best[i]; }
            out[m * T + t] = mean;
        }
    }
    free(memory);
}

/* Banana: x (4, N) per run of start (M, 4, N), F and root of Q (4, 4), sigma (2); z (M, T, 2), out (M, T, 4). */
void banana_pf(const double *F, const double *L, const double *sigma, const double *start, const double *z,
               int T, int M, int N, double *out) {
    double *x = malloc(9 * N * sizeof *x), *y = x + 4 * N, *w = y + 4 * N;
    for (int m = 0; m < M; m++) {
        memcpy(x, start + (size_t)m * 4 * N, 4 * N * sizeof *x);
        for (int t = 0; t < T; t++) {
            const double *seen = z + 2 * (m * T + t);
            double *mean = out + 4 * (m * T + t);
            for (int i = 0; i < N; i++) {
                double old[4], e[4], new[4];
                for (int c = 0; c < 4; c++) { old[c] = x[c * N + i]; e[c] = normal(); }
                for (int c = 0; c < 4; c++) {
                    double sum = 0.0;
                    for (int d = 0; d < 4; d++) sum += F[4 * c + d] * old[d];
                    for (int d = 0; d <= c; d++) sum += L[4 * c + d] * e[d];
                    x[c * N + i] = new[c] = sum;
                }
                double r = (seen[0] - sqrt(new[0] * new[0] + new[2] * new[2])) / sigma[0];
                double a = seen[1] - atan2(new[2], new[0]);
                a = (a - 2.0 * M_PI * rint(a / (2.0 * M_PI))) / sigma[1];
                w[i] = -0.5 * (r * r + a * a);
            }
            normalize(w, N);
            for (int c = 0; c < 4; c++) {
                double sum = 0.0;
                for (int i = 0; i < N; i++) sum += w[i] * x[c * N + i];
                mean[c] = sum;
            }
            resample(w, x, y, 4, N);
            double *swap = x; x = y; y = swap;
        }
    }
    free(x < y ? x : y);
}

/* Kalman filter of components 0 and 2 of a state of four; mean (M, 4), z (M, T, 2), out (M, T, 4). */
void kalman_cv(const double *F, const double *Q, const double *R, const double *mean, const double *cov,
               const double *z, int T, int M, double *out) {
    for (int m = 0; m < M; m++) {
        double x[4], P[4][4], A[4][4], y[4];
        memcpy(x, mean + 4 * m, sizeof x); memcpy(P, cov, sizeof P);
        for (int t = 0; t < T; t++) {
            for (int i = 0; i < 4; i++) {
                y[i] = 0.0;
                for (int j = 0; j < 4; j++) {
                    y[i] += F[4 * i + j] * x[j];
                    A[i][j] = 0.0;
                    for (int k = 0; k < 4; k++) A[i][j] += F[4 * i + k] * P[k][j];
                }
            }
            for (int i = 0; i < 4; i++) for (int j = 0; j < 4; j++) {
                P[i][j] = Q[4 * i + j];
                for (int k = 0; k < 4; k++) P[i][j] += A[i][k] * F[4 * j + k];
            }
            double a = P[0][0] + R[0], b = P[0][2] + R[1], d = P[2][2] + R[3], det = 1.0 / (a * d - b * b);
            const double *seen = z + 2 * (m * T + t);
            double u = seen[0] - y[0], v = seen[1] - y[2], K[4][2], row[2][4];
            for (int i = 0; i < 4; i++) {
                K[i][0] = (P[i][0] * d - P[i][2] * b) * det; K[i][1] = (P[i][2] * a - P[i][0] * b) * det;
                x[i] = y[i] + K[i][0] * u + K[i][1] * v;
                row[0][i] = P[0][i]; row[1][i] = P[2][i];
            }
            for (int i = 0; i < 4; i++) for (int j = 0; j < 4; j++) P[i][j] -= K[i][0] * row[0][j] + K[i][1] * row[1][j];
            memcpy(out + 4 * (m * T + t), x, sizeof x);
        }
    }
}

enum { MODELS = 2 };

/* One Kalman step of a model for a position in the plane; returns the density of z times 2 pi. */
static double imm_filter(const double *F, const double *Q, const double *R, double *x, double P[4][4], const double *z) {
    double y[4], A[4][4];
    for (int i = 0; i < 4; i++) {
        y[i] = 0.0;
        for (int j = 0; j < 4; j++) {
            y[i] += F[4 * i + j] * x[j];
            A[i][j] = 0.0;
            for (int k = 0; k < 4; k++) A[i][j] += F[4 * i + k] * P[k][j];
        }
    }
    for (int i = 0; i < 4; i++) for (int j = 0; j < 4; j++) {
        P[i][j] = Q[4 * i + j];
        for (int k = 0; k < 4; k++) P[i][j] += A[i][k] * F[4 * j + k];
    }
    double a = P[0][0] + R[0], b = P[0][2] + R[1], d = P[2][2] + R[3], det = 1.0 / (a * d - b * b);
    double u = z[0] - y[0], v = z[1] - y[2], K[4][2], row[2][4];
    for (int i = 0; i < 4; i++) {
        K[i][0] = (P[i][0] * d - P[i][2] * b) * det;
        K[i][1] = (P[i][2] * a - P[i][0] * b) * det;
        x[i] = y[i] + K[i][0] * u + K[i][1] * v;
        row[0][i] = P[0][i];
        row[1][i] = P[2][i];
    }
    for (int i = 0; i < 4; i++) for (int j = 0; j < 4; j++) P[i][j] -= K[i][0] * row[0][j] + K[i][1] * row[1][j];
    return sqrt(det) * exp(-0.5 * (u * u * d - 2.0 * u * v * b + v * v * a) * det);
}

/* Interacting multiple models: F and Q of each, transition[i][j] from i to j. */
void imm_cv(const double *F, const double *Q, const double *R, const double *transition, const double *mean,
            const double *cov, const double *z, int T, int M, double *out) {
    for (int m = 0; m < M; m++) {
        double x[MODELS][4], P[MODELS][4][4], mixed[MODELS][4], spread[MODELS][4][4], mu[MODELS], c[MODELS];
        for (int j = 0; j < MODELS; j++) {
            memcpy(x[j], mean + 4 * m, sizeof x[j]);
            memcpy(P[j], cov, sizeof P[j]);
            mu[j] = 1.0 / MODELS;
        }
        for (int t = 0; t < T; t++) {
            for (int j = 0; j < MODELS; j++) {
                double w[MODELS];
                c[j] = 0.0;
                for (int i = 0; i < MODELS; i++) c[j] += w[i] = transition[MODELS * i + j] * mu[i];
                for (int k = 0; k < 4; k++) {
                    mixed[j][k] = 0.0;
                    for (int i = 0; i < MODELS; i++) mixed[j][k] += w[i] / c[j] * x[i][k];
                }
                for (int k = 0; k < 4; k++) for (int l = 0; l < 4; l++) {
                    spread[j][k][l] = 0.0;
                    for (int i = 0; i < MODELS; i++)
                        spread[j][k][l] += w[i] / c[j] * (P[i][k][l] + (x[i][k] - mixed[j][k]) * (x[i][l] - mixed[j][l]));
                }
            }
            memcpy(x, mixed, sizeof x);
            memcpy(P, spread, sizeof P);
            double whole = 0.0, *estimate = out + 4 * (m * T + t);
            for (int j = 0; j < MODELS; j++) {
                mu[j] = c[j] * imm_filter(F + 16 * j, Q + 16 * j, R, x[j], P[j], z + 2 * (m * T + t));
                whole += mu[j];
            }
            for (int k = 0; k < 4; k++) estimate[k] = 0.0;
            for (int j = 0; j < MODELS; j++) {
                mu[j] /= whole;
                for (int k = 0; k < 4; k++) estimate[k] += mu[j] * x[j][k];
            }
        }
    }
}

/* Derivative of the Lorenz-96 system of n components, forcing 8, for N members x (n, N). */
static void lorenz96(const double *x, double *slope, int n, int N) {
    for (int i = 0; i < n; i++) {
        const double *here = x + i * N, *after = x + (i + 1) % n * N;
        const double *before = x + (i + n - 1) % n * N, *two_before = x + (i + n - 2) % n * N;
        double *restrict out = slope + i * N;
        for (int l = 0; l < N; l++) out[l] = (after[l] - two_before[l]) * before[l] - here[l] + 8.0;
    }
}

/* One Runge-Kutta step of members x (n, N); `work` has room for three more. */
static void lorenz96_step(double *x, double dt, double *work, int n, int N) {
    const double ahead[4] = {0.5, 0.5, 1.0, 0.0}, weight[4] = {1.0, 2.0, 2.0, 1.0};
    int all = n * N;
    double *at = work, *slope = work + all, *sum = work + 2 * all;
    memcpy(at, x, all * sizeof *x);
    memset(sum, 0, all * sizeof *x);
    for (int stage = 0; stage < 4; stage++) {
        lorenz96(at, slope, n, N);
        for (int l = 0; l < all; l++) {
            sum[l] += weight[stage] * slope[l];
            at[l] = x[l] + ahead[stage] * dt * slope[l];
        }
    }
    for (int l = 0; l < all; l++) x[l] += dt / 6.0 * sum[l];
}

/* Ensemble Kalman filter with centered perturbations for Lorenz-96, all components measured with variance R.
   p: sigma of the start, R, dt, inflation; mean (n); z and out (M, T, n). */
void lorenz96_enkf(const double *p, const double *mean, const double *z, int T, int M, int n, int N, double *out) {
    int all = n * N;
    double *x = malloc((5 * all + 2 * n * n) * sizeof *x);
    double *error = x + all, *work = x + 2 * all, *cov = x + 5 * all, *L = cov + n * n;
    for (int m = 0; m < M; m++) {
        for (int i = 0; i < n; i++) for (int l = 0; l < N; l++) x[i * N + l] = mean[i] + p[0] * normal();
        for (int t = 0; t < T; t++) {
            const double *seen = z + (size_t)n * (m * T + t);
            double *estimate = out + (size_t)n * (m * T + t), *members = work;
            lorenz96_step(x, p[2], work, n, N);
            /* Deviations, a member after the other, and their covariance C. */
            for (int i = 0; i < n; i++) {
                double sum = 0.0, drift = 0.0, *e = error + i * N;
                for (int l = 0; l < N; l++) sum += x[i * N + l];
                for (int l = 0; l < N; l++) members[l * n + i] = x[i * N + l] - sum / N;
                for (int l = 0; l < N; l++) drift += e[l] = sqrt(p[1] * N / (N - 1.0)) * normal();
                for (int l = 0; l < N; l++) e[l] += seen[i] - x[i * N + l] - drift / N;
            }
            memset(cov, 0, n * n * sizeof *cov);
            for (int l = 0; l < N; l++)
                for (int i = 0; i < n; i++) {
                    double a = members[l * n + i] / (N - 1.0), *restrict row = cov + i * n;
                    for (int j = 0; j < n; j++) row[j] += a * members[l * n + j];
                }
            /* S = C + R = L L', by columns, each kept as a row of L. */
            memcpy(L, cov, n * n * sizeof *L);
            for (int j = 0; j < n; j++) {
                double *column = L + j * n;
                column[j] += p[1];
                for (int k = 0; k < j; k++) {
                    double a = L[k * n + j];
                    for (int i = j; i < n; i++) column[i] -= a * L[k * n + i];
                }
                double root = sqrt(column[j]);
                for (int i = j; i < n; i++) column[i] /= root;
            }
            /* S^-1 of the innovations, of all members at once. */
            for (int i = 0; i < n; i++) {
                double *restrict e = error + i * N;
                for (int k = 0; k < i; k++) for (int l = 0; l < N; l++) e[l] -= L[k * n + i] * error[k * N + l];
                for (int l = 0; l < N; l++) e[l] /= L[i * n + i];
            }
            for (int i = n - 1; i >= 0; i--) {
                double *restrict e = error + i * N;
                for (int k = i + 1; k < n; k++) for (int l = 0; l < N; l++) e[l] -= L[i * n + k] * error[k * N + l];
                for (int l = 0; l < N; l++) e[l] /= L[i * n + i];
            }
            for (int i = 0; i < n; i++) {
                double sum = 0.0, *restrict row = x + i * N;
                for (int k = 0; k < n; k++) for (int l = 0; l < N; l++) row[l] += cov[i * n + k] * error[k * N + l];
                for (int l = 0; l < N; l++) sum += row[l];
                estimate[i] = sum / N;
                for (int l = 0; l < N; l++) row[l] = sum / N + p[3] * (row[l] - sum / N);
            }
        }
    }
    free(x);
}
