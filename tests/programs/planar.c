/* A Kalman filter of a planar target (px, vx, py, vy) with white acceleration, by lines of text.

It measures positions, or range and azimuth (extended Kalman filter), with noise of its own:
parameters q (m^2/s^3), sigma (m) and sigma_azimuth (rad). Compiled with -DFAULT=n it has a mistake. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#ifndef FAULT
#define FAULT 0
#endif
enum { GOOD, ZERO, SIGMA, FIRST_INTERVAL, SWAPPED, NO_GAIN, LATE, DEGREES, NO_PROPAGATION, HALF, CARRIED, NO_WRAP };
#define FOR(i) for (int i = 0; i < 4; i++)

static double x[4], P[4][4], late_x[4], late_P[4][4], q = 1, sigma = 10, sigma_azimuth = 0.003;

static void parameter(const char *json, const char *name, double *value) {
    const char *at = strstr(json, name); /* with the space that the model's own keys lack */
    if (at) *value = atof(strchr(at, ':') + 1);
}

static void predict(double dt) {
    static double first;
    if (FAULT == FIRST_INTERVAL) {
        if (!first) first = dt;
        dt = first;
    }
    double F[4][4] = {{1, dt}, {0, 1}, {0, 0, 1, dt}, {0, 0, 0, 1}}, FP[4][4] = {{0}}, old[4];
    double a = q * dt * dt * dt / 3, b = q * dt * dt / 2, c = q * dt, half = FAULT == HALF ? 0.5 : 1;
    double Q[4][4] = {{a, b}, {b, c}, {0, 0, a, b}, {0, 0, b, c}};
    memcpy(old, x, sizeof x);
    /* x = F x, P = F P F' + Q */
    FOR(i) { x[i] = 0; FOR(j) x[i] += F[i][j] * old[j]; }
    FOR(i) FOR(j) FOR(k) FP[i][j] += F[i][k] * P[k][j];
    FOR(i) FOR(j) {
        double sum = half * Q[i][j];
        FOR(k) sum += FP[i][k] * F[j][k];
        P[i][j] = FAULT == NO_PROPAGATION ? P[i][j] + Q[i][j] : sum;
    }
}

/* Update with one component: innovation nu, row h of the Jacobian, variance r. */
static void update(double nu, const double *h, double r) {
    double Ph[4] = {0}, S = r;
    FOR(i) FOR(j) Ph[i] += P[i][j] * h[j];
    FOR(i) S += h[i] * Ph[i];
    FOR(i) x[i] += Ph[i] / S * nu;
    if (FAULT != NO_GAIN) FOR(i) FOR(j) P[i][j] -= Ph[i] * Ph[j] / S;
}

static void measure(const char *line, int polar) {
    char *end;
    double z[2] = {strtod(line, &end), strtod(end, NULL)}, r = sigma * sigma;
    if (FAULT == SIGMA) r = sigma;
    if (FAULT == SWAPPED) { double other = z[0]; z[0] = z[1]; z[1] = other; }
    if (FAULT == ZERO) { if (isnan(z[0])) z[0] = 0; if (isnan(z[1])) z[1] = 0; }
    if (!polar) {
        double h[2][4] = {{1}, {0, 0, 1}}, at[2] = {x[0], x[2]};
        for (int i = 0; i < 2; i++)
            if (!isnan(z[i])) update(z[i] - (i ? x[2] : at[0]), h[i], r);
        return;
    }
    double px = x[0], py = x[2], s = px * px + py * py, range = sqrt(s), azimuth = atan2(py, px);
    double h[2][4] = {{px / range, 0, py / range}, {-py / s, 0, px / s}}, from[4];
    if (FAULT == DEGREES) azimuth *= 180 / M_PI;
    memcpy(from, x, sizeof x);
    double nu = z[0] - range, turn = remainder(z[1] - azimuth, 2 * M_PI);
    if (FAULT == NO_WRAP) turn = z[1] - azimuth;
    if (!isnan(z[0])) update(nu, h[0], r);
    /* The second update is about the state before the first: h (x - from) is known by now. */
    FOR(i) turn -= h[1][i] * (x[i] - from[i]);
    if (!isnan(z[1])) update(turn, h[1], sigma_azimuth * sigma_azimuth);
}

static void answer(void) {
    static double out_x[4], out_P[4][4];
    memcpy(out_x, FAULT == LATE ? late_x : x, sizeof x);
    memcpy(out_P, FAULT == LATE ? late_P : P, sizeof P);
    memcpy(late_x, x, sizeof x);
    memcpy(late_P, P, sizeof P);
    FOR(i) printf("%.17g ", out_x[i]);
    FOR(i) FOR(j) printf("%.17g%c", out_P[i][j], i + j < 6 ? ' ' : '\n');
    fflush(stdout);
}

int main(void) {
    static char line[1 << 16];
    int polar = 0, runs = 0;
    double time = 0, now;
    while (fgets(line, sizeof line, stdin)) {
        char *next = strchr(line, ' ');
        if (!strncmp(line, "trackbench 1 ", 13)) {
            polar = strstr(line, "azimuth") != NULL && strstr(line, "range") != NULL;
            parameter(line, "\"q\": ", &q);
            parameter(line, "\"sigma\": ", &sigma);
            parameter(line, "\"sigma_azimuth\": ", &sigma_azimuth);
            puts("ready");
            fflush(stdout);
        } else if (!strncmp(line, "init ", 5)) {
            strtod(next, &next);
            time = strtod(next, &next);
            FOR(i) { double v = strtod(next, &next); if (FAULT != CARRIED || !runs) x[i] = v; }
            FOR(i) FOR(j) P[i][j] = strtod(next, &next);
            memcpy(late_x, x, sizeof x);
            memcpy(late_P, P, sizeof P);
            runs++;
            answer();
        } else if (!strncmp(line, "step ", 5)) {
            now = strtod(next, &next);
            predict(now - time);
            time = now;
            measure(next, polar);
            answer();
        } else {
            return 0; /* end */
        }
    }
    return 0;
}
