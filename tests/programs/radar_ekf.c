/* An extended Kalman filter of a radar, which takes motion, sigmas and place of the radar from the first line. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { N = 4 }; /* px, vx, py, vy */
static const double PI = 3.14159265358979323846;
static double F[N][N], Q[N][N], x[N], P[N][N];
static double at[2], sigma[2]; /* place of the radar, m; standard deviations of range, m, and azimuth, rad */

/* Read the numbers of a key, in whatever brackets; 0 if the key is not in the text. */
static int read_key(const char *json, const char *key, int count, double numbers[]) {
    char quoted[64], *place;
    snprintf(quoted, sizeof quoted, "\"%s\":", key);
    if (!json || !(place = strstr(json, quoted))) return 0;
    place += strlen(quoted);
    for (int i = 0; i < count; i++) {
        place += strspn(place, "[],");
        numbers[i] = strtod(place, &place);
    }
    return 1;
}

/* Read the model of the problem; return why the filter does not fit it, or NULL.
 * With two sensors the list "measurement" is longer, so the filter refuses them. */
static const char *read_model(const char *json) {
    const char *motion = strstr(json, "\"motion\":{"), *sensors = strstr(json, "\"sensors\":[");
    if (!strstr(json, "\"components\": [\"px\", \"vx\", \"py\", \"vy\"], \"measurement\": [\"range\", \"azimuth\"]"))
        return "needs the state px vx py vy and the measurement range azimuth";
    if (!sensors || !read_key(sensors, "at", 2, at) || !read_key(sensors, "sigma_range", 1, &sigma[0])
        || !read_key(sensors, "sigma_azimuth", 1, &sigma[1]))
        return "needs a sensor range-azimuth at rest";
    if (!read_key(motion, "F", N * N, F[0]) || !read_key(motion, "Q", N * N, Q[0]))
        return "needs a linear motion and equal steps";
    return NULL;
}

static void predict(void) {
    double Fx[N] = {0}, FP[N][N] = {{0}};
    for (int i = 0; i < N; i++)
        for (int k = 0; k < N; k++) {
            Fx[i] += F[i][k] * x[k];
            for (int j = 0; j < N; j++) FP[i][j] += F[i][k] * P[k][j];
        }
    for (int i = 0; i < N; i++) {
        x[i] = Fx[i];
        for (int j = 0; j < N; j++) {
            P[i][j] = Q[i][j];
            for (int k = 0; k < N; k++) P[i][j] += FP[i][k] * F[j][k];
        }
    }
}

static void update(const double z[2]) {
    double dx = x[0] - at[0], dy = x[2] - at[1], r = hypot(dx, dy), predicted[N];
    double h[2] = {r, atan2(dy, dx)};
    double H[2][N] = {{dx / r, 0, dy / r, 0}, {-dy / (r * r), 0, dx / (r * r), 0}};
    memcpy(predicted, x, sizeof x);
    for (int c = 0; c < 2; c++) { /* range, then azimuth, both linear about the predicted state */
        double innovation = z[c] - h[c], S = sigma[c] * sigma[c], PH[N] = {0};
        if (isnan(innovation)) continue; /* this component is missing */
        if (c == 1) innovation = remainder(innovation, 2 * PI);
        for (int i = 0; i < N; i++) {
            innovation -= H[c][i] * (x[i] - predicted[i]);
            for (int j = 0; j < N; j++) PH[i] += P[i][j] * H[c][j];
        }
        for (int i = 0; i < N; i++) S += H[c][i] * PH[i];
        for (int i = 0; i < N; i++) {
            x[i] += PH[i] / S * innovation;
            for (int j = 0; j < N; j++) P[i][j] -= PH[i] * PH[j] / S;
        }
    }
}

int main(void) {
    static char line[1 << 16];
    if (!fgets(line, sizeof line, stdin)) return 1;
    const char *why = read_model(line);
    if (why) printf("error %s\n", why);
    else puts("ready");
    while (!fflush(stdout) && fgets(line, sizeof line, stdin) && strncmp(line, "end", 3)) {
        char *place = strchr(line, ' ');
        if (line[0] == 'i') { /* init SEED TIME mean cov */
            strtod(place, &place), strtod(place, &place);
            for (int i = 0; i < N; i++) x[i] = strtod(place, &place);
            for (int i = 0; i < N * N; i++) P[i / N][i % N] = strtod(place, &place);
        } else { /* step TIME z */
            strtod(place, &place);
            double z[2] = {strtod(place, &place)};
            z[1] = strtod(place, &place);
            predict();
            update(z);
        }
        for (int i = 0; i < N; i++) printf("%.17g ", x[i]);
        for (int i = 0; i < N * N; i++) printf("%.17g%c", P[i / N][i % N], i < N * N - 1 ? ' ' : '\n');
    }
    return 0;
}
