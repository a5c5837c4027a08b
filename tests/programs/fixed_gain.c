/* A filter of constant gain for positions in the plane, and main(), which calls it by lines of text. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* The filter: your functions stand here. Its state is x, y, vx, vy, and its gain is for steps of 1 s. */
enum { N = 4, NZ = 2 };
static const char *STATE[N] = {"px", "py", "vx", "vy"}; /* trackbench's names, in the filter's order */
static const char *MEASUREMENT[NZ] = {"x", "y"};
static double s[N];

static void step(const double z[NZ], double dt) {
    for (int i = 0; i < 2; i++) {
        double predicted = s[i] + dt * s[i + 2], innovation = z[i] - predicted;
        s[i] = predicted + 0.5 * innovation;
        s[i + 2] += 0.2 * innovation / dt;
    }
}

static double covariance(int i, int j) {
    static const double P[2][2] = {{12.5, 5}, {5, 5}};
    return i % 2 == j % 2 ? P[i / 2][j / 2] : 0;
}

/* Find the i-th name of the filter in the list after the key. Write its place in the list, which counts from 0, to place[i].
 * Return 1 if the list has all names of the filter and no other name, and 0 otherwise. */
static int find_places(const char *json, const char *key, const char **names, int n, int place[]) {
    int found = 0, number = 0;
    const char *at = strstr(json, key);
    for (at = strchr(at, '[') + 1; *at != ']'; number++) {
        const char *word = strchr(at, '"') + 1, *end = strchr(word, '"');
        for (int i = 0; i < n; i++)
            if (strlen(names[i]) == (size_t)(end - word) && !strncmp(names[i], word, end - word)) {
                place[i] = number;
                found++;
            }
        at = end + 1;
    }
    return found == n && number == n;
}

int main(void) {
    static char line[1 << 16];
    int state[N], measurement[NZ];
    double last = 0;
    if (!fgets(line, sizeof line, stdin)) return 1;
    if (!find_places(line, "\"components\"", STATE, N, state)) puts("error needs the state px py vx vy");
    else if (!find_places(line, "\"measurement\"", MEASUREMENT, NZ, measurement)) puts("error measures x y");
    else puts("ready");
    while (!fflush(stdout) && fgets(line, sizeof line, stdin) && strncmp(line, "end", 3)) {
        char *at = strchr(line, ' ');
        double numbers[N], z[NZ], answer[N], P[N][N], time;
        int is_start = line[0] == 'i';
        if (is_start) strtod(at, &at); /* SEED */
        time = strtod(at, &at);
        for (int i = 0; i < (is_start ? N : NZ); i++) numbers[i] = strtod(at, &at);
        if (is_start) {
            for (int i = 0; i < N; i++) s[i] = numbers[state[i]];
        } else {
            for (int i = 0; i < NZ; i++) z[i] = numbers[measurement[i]];
            /* Over a missing measurement the filter predicts. */
            for (int i = 0; i < NZ; i++) if (isnan(z[i])) z[i] = s[i] + (time - last) * s[i + 2];
            step(z, time - last);
        }
        last = time;
        for (int i = 0; i < N; i++) answer[state[i]] = s[i];
        for (int i = 0; i < N; i++) for (int j = 0; j < N; j++) P[state[i]][state[j]] = covariance(i, j);
        for (int i = 0; i < N; i++) printf("%.17g ", answer[i]);
        for (int i = 0; i < N * N; i++) printf("%.17g%c", P[i / N][i % N], i < N * N - 1 ? ' ' : '\n');
    }
    return 0;
}
