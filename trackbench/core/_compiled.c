/* Kernels of core/ in C: the operations of the numpy versions, in their order, so that every byte is equal.

   Each function names the Python function that it stands in for; the formulas are explained there. Arrays
   arrive as contiguous buffers of float64 or int64 whose shapes the caller guarantees. Compiled without
   contraction to fused multiply-adds and without reassociation (build_compiled.py). */

#define Py_LIMITED_API 0x030b0000
#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

/* Kernels whose loops are sums and products also for four numbers at a time; each rounds as it does alone. */
#if defined(__x86_64__) && defined(__GLIBC__) && defined(__has_attribute)
#if __has_attribute(target_clones)
#define WIDE __attribute__((target_clones("avx2", "default")))
#endif
#endif
#ifndef WIDE
#define WIDE
#endif
/* Before a loop that writes to no memory that another iteration reads. */
#ifdef __clang__
#define INDEPENDENT _Pragma("clang loop vectorize(assume_safety)")
#else
#define INDEPENDENT _Pragma("GCC ivdep")
#endif

typedef Py_ssize_t Size;
enum { POWERS = 1 << 14, LOGS = 1 << 13, TURNS = 1 << 11, SLOPES = 1 << 8, QUADS = 4096 };
static const double ROUND = 1.5 * 4503599627370496.0;

static inline int64_t bits_of(double x) { int64_t n; memcpy(&n, &x, 8); return n; }
static inline double of_bits(int64_t n) { double x; memcpy(&x, &n, 8); return x; }

static int any_nan(const double *a, Size n) {
  int found = 0;
  for (Size i = 0; i < n; i++) found |= a[i] != a[i];
  return found;
}

/* ---- arguments ---- */

typedef struct { Py_buffer views[24]; int count; } Buffers;

static void release(Buffers *b) { while (b->count) PyBuffer_Release(&b->views[--b->count]); }

/* Open the first n arguments; those from `written` on are written to. Return whether all could be opened. */
static int open_buffers(Buffers *b, PyObject *const *args, Size given, int n, int written) {
  b->count = 0;
  if (given < n) { PyErr_SetString(PyExc_TypeError, "too few arguments"); return 0; }
  for (int i = 0; i < n; i++) {
    if (PyObject_GetBuffer(args[i], &b->views[i], i < written ? PyBUF_SIMPLE : PyBUF_WRITABLE)) { release(b); return 0; }
    b->count++;
  }
  return 1;
}

#define DOUBLES(i) ((double *)b.views[i].buf)
#define INTS(i) ((int64_t *)b.views[i].buf)
#define LENGTH(i) (b.views[i].len / 8)
#define WHOLE(i) PyLong_AsSsize_t(args[i])
#define KERNEL(name) static PyObject *name(PyObject *self, PyObject *const *args, Size given)
#define OPEN(n, written) Buffers b; if (!open_buffers(&b, args, given, n, written)) return NULL
#define DONE release(&b); if (PyErr_Occurred()) return NULL; Py_RETURN_NONE

/* ---- elementary functions: exp_log_sin_arctan.py ---- */

/* e^x for x in [-708, 709]; c = per_power, step, step_squared. */
static inline double exp_of_moderate(double x, const double *powers, const double *c) {
  double f = x * c[0], rounded = f + ROUND, whole = rounded - ROUND;
  f -= whole;
  double series = f * c[2];
  series += c[1];
  series *= f;
  series += 1.0;
  int64_t n = bits_of(rounded);
  double power = powers[n & (POWERS - 1)];
  return of_bits((int64_t)((uint64_t)bits_of(power) + ((uint64_t)(n >> 14) << 52))) * series;
}

/* e^x for any x. */
static inline double exp_of(double x, const double *powers, const double *c) {
  return x < -708.0 ? 0.0 : x > 709.7 ? INFINITY : exp_of_moderate(x, powers, c);
}

/* exp(powers, constants, x, out) */
KERNEL(c_exp) {
  OPEN(4, 3);
  const double *powers = DOUBLES(0), *c = DOUBLES(1), *x = DOUBLES(2);
  double *out = DOUBLES(3);
  for (Size i = 0; i < LENGTH(2); i++) out[i] = exp_of(x[i], powers, c);
  DONE;
}

/* log x of a normal number; c = log_linear, log_square, log_2 / 2^52, log_2, then each cell's log and inverse. */
static inline double log_of_normal(double x, const double *c) {
  enum { CELL = 52 + 1 - 14 };
  int64_t e = bits_of(x) - 0x3FE8000000000000, index = (e >> CELL) & (LOGS - 1);
  e &= (int64_t)(~(uint64_t)0 << 52);
  int64_t m = bits_of(x) - e, edge = (int64_t)((uint64_t)(m >> CELL) << CELL);
  double r = of_bits(m) - of_bits(edge);
  const double *cell = c + 4 + 2 * index;
  r *= cell[1];
  double series = c[0] * r;
  series += c[1];
  series *= r;
  series *= r;
  series += r;
  series += cell[0];
  return (double)e * c[2] + series;
}

/* log v of any number */
static inline double log_of(double v, const double *c) {
  if (v >= 0x1p-1022 && v < INFINITY) return log_of_normal(v, c);
  if (v > 0.0 && v < 1.0) return log_of_normal(v * 0x1p52, c) - 52 * c[3];
  return v == 0.0 ? -INFINITY : v > 0.0 ? INFINITY : NAN;
}

/* log(logs, x, out): `log_table`. */
KERNEL(c_log) {
  OPEN(3, 2);
  const double *logs = DOUBLES(0), *x = DOUBLES(1);
  double *out = DOUBLES(2);
  for (Size i = 0; i < LENGTH(1); i++) out[i] = log_of(x[i], logs);
  DONE;
}

/* gamma_log_density(logs, v, out, shape - 1, rate, log_norm): `Gamma.log_density`. */
KERNEL(c_gamma_log_density) {
  OPEN(3, 2);
  const double *logs = DOUBLES(0), *v = DOUBLES(1);
  double *restrict out = DOUBLES(2), power = PyFloat_AsDouble(args[3]), rate = PyFloat_AsDouble(args[4]);
  double log_norm = PyFloat_AsDouble(args[5]);
  Size n = LENGTH(1);
  /* Loops of their own for both conditions: the sign of v is random, and a jump that depends on it costs more. */
  for (Size i = 0; i < n; i++) out[i] = v[i] > 0x1p-1022 ? v[i] : 0x1p-1022; /* also of NaN: rate v is NaN again */
  for (Size i = 0; i < n; i++) {
    double log_p = log_of(out[i], logs);
    log_p *= power;
    log_p -= rate * v[i];
    out[i] = log_p + log_norm;
  }
  for (Size i = 0; i < n; i++) out[i] = v[i] <= 0.0 ? -INFINITY : out[i];
  DONE;
}

/* cos_sin(cosines, sines, constants, a, c, s); constants = per_turn, 2 pi, turn in three parts. */
KERNEL(c_cos_sin) {
  OPEN(6, 4);
  const double *cosines = DOUBLES(0), *sines = DOUBLES(1), *k = DOUBLES(2), *a = DOUBLES(3);
  double *c = DOUBLES(4), *s = DOUBLES(5);
  for (Size i = 0; i < LENGTH(3); i++) {
    double angle = a[i];
    if (!(fabs(angle) <= 1e6)) angle = fmod(angle, k[1]);
    double rounded = angle * k[0] + ROUND;
    int64_t index = bits_of(rounded) & (TURNS - 1);
    rounded -= ROUND;
    double r = angle - rounded * k[2];
    r -= rounded * k[3];
    r -= rounded * k[4];
    double square = r * r;
    double cosine = square * (1.0 / 24.0);
    cosine -= 0.5;
    cosine *= square;
    double sine = square * (1.0 / 120.0);
    sine -= 1.0 / 6.0;
    sine *= square;
    sine *= r;
    sine += r;
    double C = cosines[index], S = sines[index];
    c[i] = (C * cosine - S * sine) + C;
    s[i] = (S * cosine + C * sine) + S;
  }
  DONE;
}

/* The angle of (x, y); table has the arctangents. */
static inline double arctan2_of(double y, double x, const double *table, double pi) {
  double t = y / x, ax = fabs(x), ay = fabs(y);
  if (fabs(t) <= 1.0 / 32.0 && x > 0.0) { /* Gregory's series */
    double square = t * t, series = square * (1.0 / 9.0);
    series -= 1.0 / 7.0;
    series *= square;
    series += 1.0 / 5.0;
    series *= square;
    series -= 1.0 / 3.0;
    series *= square;
    series *= t;
    return t + series;
  }
  double large = ax > ay ? ax : ay, small = ax > ay ? ay : ax, angle = NAN;
  if (ax == ax && ay == ay) {
    if (large == INFINITY) { /* the diagonal of two infinities, or the axis of one */
      small = small == INFINITY ? 1.0 : 0.0;
      large = 1.0;
    }
    double rounded = small / large * SLOPES + ROUND;
    int64_t index = bits_of(rounded) & (2 * SLOPES - 1);
    double slope = (rounded - ROUND) * (1.0 / SLOPES);
    double r = (small - slope * large) / (large + slope * small), square = r * r;
    angle = table[index > SLOPES ? SLOPES : index] + (r + r * square * (square * (1.0 / 5.0) - 1.0 / 3.0));
    if (large == 0.0) angle = 0.0;
    if (ay > ax) angle = 0.5 * pi - angle;
    if (x < 0.0) angle = pi - angle;
  }
  return copysign(angle, y);
}

/* arctan2(arctangents, constants, y, x, out); constants = pi. */
KERNEL(c_arctan2) {
  OPEN(5, 4);
  const double *table = DOUBLES(0), pi = DOUBLES(1)[0], *y = DOUBLES(2), *x = DOUBLES(3);
  double *out = DOUBLES(4);
  for (Size i = 0; i < LENGTH(2); i++) out[i] = arctan2_of(y[i], x[i], table, pi);
  DONE;
}

/* line_of_sight(c, s, px, py, r, across, along): `along_line_of_sight` of positions (M, N) about c, s (M). */
KERNEL(c_line_of_sight) {
  OPEN(7, 4);
  Size M = LENGTH(0), N = M ? LENGTH(2) / M : 0;
  const double *px = DOUBLES(2), *py = DOUBLES(3);
  double *restrict r = DOUBLES(4), *restrict across = DOUBLES(5), *restrict along = DOUBLES(6);
  for (Size m = 0; m < M; m++) {
    double c = DOUBLES(0)[m], s = DOUBLES(1)[m];
    for (Size i = m * N; i < (m + 1) * N; i++) {
      along[i] = c * px[i] + s * py[i];
      across[i] = c * py[i] - s * px[i];
      r[i] = sqrt(along[i] * along[i] + across[i] * across[i]);
    }
  }
  DONE;
}

/* ---- variates: random_streams.py ---- */

/* normals(table, words, out): a Hadamard matrix times four table entries, in pieces of QUADS words. */
KERNEL(c_normals) {
  OPEN(3, 2);
  const float *table = b.views[0].buf;
  const uint16_t *index = b.views[1].buf;
  double *out = DOUBLES(2);
  for (Size done = 0, words = LENGTH(1); done < words; done += QUADS) {
    Size n = words - done < QUADS ? words - done : QUADS;
    const uint16_t *i = index + 4 * done;
    double *o = out + 4 * done;
    for (Size k = 0; k < n; k++) {
      float first = table[i[k]], second = table[i[n + k]], third = table[i[2 * n + k]], fourth = table[i[3 * n + k]];
      float sum = first + second, difference = first - second, more = third + fourth, less = third - fourth;
      o[k] = (double)(sum + more);
      o[n + k] = (double)(sum - more);
      o[2 * n + k] = (double)(difference + less);
      o[3 * n + k] = (double)(difference - less);
    }
  }
  DONE;
}

/* erlang(table, words, out, shape): sums of so many entries, in pieces of 4 QUADS sums; `standard_gamma`. */
KERNEL(c_erlang) {
  OPEN(3, 2);
  const float *table = b.views[0].buf;
  const uint16_t *index = b.views[1].buf;
  double *out = DOUBLES(2);
  Size shape = WHOLE(3), count = LENGTH(2);
  for (Size done = 0; done < count; done += 4 * QUADS) {
    Size n = count - done < 4 * QUADS ? count - done : 4 * QUADS;
    const uint16_t *i = index + shape * done;
    for (Size k = 0; k < n; k++) {
      float sum = table[i[k]];
      for (Size j = 1; j < shape; j++) sum += table[i[j * n + k]];
      out[done + k] = (double)sum;
    }
  }
  DONE;
}

/* ---- sums in a fixed order: sums.py ---- */

/* Add the products of two rows (or one row, if b is NULL) in blocks, as `_by_blocks` does. */
static inline Size by_blocks(const double *a, const double *b, Size n, Size block, double *sums) {
  for (Size j = 0; j < block; j++) sums[j] = 0.0 + (b ? a[j] * b[j] : a[j]);
  for (Size i = block; i < n; i += block) {
    Size width = n - i < block ? n - i : block;
    if (b) for (Size j = 0; j < width; j++) sums[j] += a[i + j] * b[i + j];
    else for (Size j = 0; j < width; j++) sums[j] += a[i + j];
  }
  return block;
}

/* The sum of a row; numpy begins it with 0.0, which shows if all terms are -0.0, but not that of one row alone. */
static inline double row_sum(const double *a, const double *b, Size n, int alone) {
  double first[512], second[128], sum;
  if (n >= 4096) { n = by_blocks(a, b, n, 512, first); a = first; b = NULL; }
  if (n >= 256) { n = by_blocks(a, b, n, 128, second); a = second; b = NULL; }
  if (!n) return 0.0;
  sum = b ? a[0] * b[0] : a[0];
  if (!alone) sum += 0.0;
  if (b) for (Size j = 1; j < n; j++) sum += a[j] * b[j];
  else for (Size j = 1; j < n; j++) sum += a[j];
  return sum;
}

/* Sums of rows; eight short rows at a time, since each addition waits for the one before. */
static void row_sums(const double *a, const double *b, Size rows, Size n, Size b_rows, double *out) {
  Size r = 0;
  if (n < 256 && n)
    for (; r + 8 <= rows && (!b || r % b_rows + 8 <= b_rows); r += 8) {
      const double *p = a + r * n, *q = b ? b + r % b_rows * n : NULL;
      double sums[8];
      for (int k = 0; k < 8; k++) sums[k] = 0.0 + (q ? p[k * n] * q[k * n] : p[k * n]);
      if (q) for (Size j = 1; j < n; j++) for (int k = 0; k < 8; k++) sums[k] += p[k * n + j] * q[k * n + j];
      else for (Size j = 1; j < n; j++) for (int k = 0; k < 8; k++) sums[k] += p[k * n + j];
      memcpy(out + r, sums, sizeof sums);
    }
  for (; r < rows; r++) out[r] = row_sum(a + r * n, b ? b + r % b_rows * n : NULL, n, rows == 1);
}

/* total(rows, out, n) */
KERNEL(c_total) {
  OPEN(2, 1);
  row_sums(DOUBLES(0), NULL, LENGTH(1), WHOLE(2), 1, DOUBLES(1));
  DONE;
}

/* dot(a, b, out, n): rows of b are used again and again. */
KERNEL(c_dot) {
  OPEN(3, 2);
  Size n = WHOLE(3);
  if (n > 0) row_sums(DOUBLES(0), DOUBLES(1), LENGTH(2), n, LENGTH(1) / n, DOUBLES(2));
  DONE;
}

/* window_sums(windows, rows, sums, gaps, M): add rows (S, M) to the sums (W, M) of the windows (W, S) that they are
   in, but no NaN, which is counted; `WindowSums`. */
KERNEL(c_window_sums) {
  OPEN(4, 2);
  Size M = WHOLE(4), S = M > 0 ? LENGTH(1) / M : 0, W = M > 0 ? LENGTH(2) / M : 0;
  const char *in = b.views[0].buf;
  int missing = any_nan(DOUBLES(1), LENGTH(1));
  for (Size i = 0; i < S; i++)
    for (Size w = 0; w < W; w++) {
      const double *row = DOUBLES(1) + i * M;
      double *restrict sums = DOUBLES(2) + w * M, *restrict gaps = DOUBLES(3) + w * M;
      if (!in[w * S + i]) continue;
      if (missing)
        for (Size m = 0; m < M; m++) {
          gaps[m] += row[m] == row[m] ? 0.0 : 1.0;
          sums[m] += row[m] == row[m] ? row[m] : 0.0;
        }
      else for (Size m = 0; m < M; m++) sums[m] += row[m];
    }
  DONE;
}

/* ---- particles.py and resampling.py ---- */

/* normalize(powers, constants, log_w, w, top, scale, collapsed, N): constants of exp, then the clip and its weight. */
WIDE KERNEL(c_normalize) {
  OPEN(7, 3);
  const double *powers = DOUBLES(0), *c = DOUBLES(1);
  Size N = WHOLE(7);
  for (Size m = 0; m < LENGTH(4); m++) {
    const double *log_w = DOUBLES(2) + m * N;
    double *w = DOUBLES(3) + m * N, top = log_w[0], tops[8];
    /* The largest of each eighth of the log-weights, since each comparison waits for the one before. */
    for (int k = 0; k < 8; k++) tops[k] = top;
    for (Size i = 0; i + 8 <= N; i += 8)
      for (int k = 0; k < 8; k++) tops[k] = log_w[i + k] > tops[k] ? log_w[i + k] : tops[k];
    for (int k = 0; k < 8; k++) top = tops[k] > top ? tops[k] : top;
    for (Size i = N - N % 8; i < N; i++) top = log_w[i] > top ? log_w[i] : top;
    if (any_nan(log_w, N)) top = NAN;
    DOUBLES(4)[m] = top;
    ((char *)b.views[6].buf)[m] = top == -INFINITY;
    for (Size i = 0; i < N; i++) {
      double shifted = top == -INFINITY ? 0.0 : log_w[i] - top;
      if (shifted < c[3]) shifted = c[3];
      w[i] = exp_of_moderate(shifted, powers, c) - c[4];
    }
    double scale = row_sum(w, NULL, N, LENGTH(4) == 1), factor = 1.0 / scale;
    DOUBLES(5)[m] = scale;
    for (Size i = 0; i < N; i++) w[i] *= factor;
  }
  DONE;
}

/* moments(x, w, mean, cov, n): mean and covariance about it, a run at a time in the cache. */
WIDE KERNEL(c_moments) {
  OPEN(4, 2);
  Size n = WHOLE(4), M = n > 0 ? LENGTH(2) / n : 0, N = M ? LENGTH(1) / M : 0;
  double *e = malloc(sizeof(double) * (n + 1) * (N + 1)), *weighted = e + n * N;
  if (!e) { release(&b); return PyErr_NoMemory(); }
  for (Size m = 0; m < M; m++) {
    const double *w = DOUBLES(1) + m * N;
    for (Size i = 0; i < n; i++) {
      const double *x = DOUBLES(0) + (i * M + m) * N;
      double mean = row_sum(x, w, N, n * M == 1);
      DOUBLES(2)[i * M + m] = mean;
      for (Size k = 0; k < N; k++) e[i * N + k] = x[k] - mean;
    }
    for (Size i = 0; i < n; i++) {
      for (Size k = 0; k < N; k++) weighted[k] = e[i * N + k] * w[k];
      for (Size j = 0; j <= i; j++)
        DOUBLES(3)[(i * n + j) * M + m] = DOUBLES(3)[(j * n + i) * M + m] = row_sum(e + j * N, weighted, N, (i + 1) * M == 1);
    }
  }
  free(e);
  DONE;
}

/* ancestors(w, u, index, size, bits): systematic resampling in fixed-point numbers, `_systematic_edges`. */
KERNEL(c_ancestors) {
  OPEN(3, 2);
  Size size = WHOLE(3), bits = WHOLE(4), M = LENGTH(1), N = M ? LENGTH(0) / M : 0;
  double one = (double)((int64_t)1 << bits), scale = (double)size * one;
  int64_t *ends = malloc(sizeof(int64_t) * (size + 1));
  if (!ends) { release(&b); return PyErr_NoMemory(); }
  for (Size m = 0; m < M; m++) {
    const double *w = DOUBLES(0) + m * N;
    int diverged = !isfinite(w[N - 1]);
    int64_t sum = (int64_t)((1.0 - DOUBLES(1)[m]) * one), ancestor = m * N, *index = INTS(2) + m * size;
    /* Count the particles whose offspring end at each place; the ancestor is the number that ended before. */
    memset(ends, 0, sizeof(int64_t) * (size + 1));
    for (Size j = 0; j < N - 1; j++) {
      sum += (int64_t)((diverged ? 1.0 / (double)N : w[j]) * scale);
      uint64_t end = (uint64_t)(sum >> bits);
      ends[end > (uint64_t)size ? (uint64_t)size : end]++;
    }
    for (Size i = 0; i < size; i++) index[i] = ancestor += ends[i];
  }
  free(ends);
  DONE;
}

/* select(values, index, out): items of 8 bytes of each component at flat indices. */
KERNEL(c_select) {
  OPEN(3, 2);
  Size count = LENGTH(1), n = count ? LENGTH(2) / count : 0, length = n ? LENGTH(0) / n : 0;
  const int64_t *index = INTS(1);
  for (Size k = 0; k < count; k++)
    if (index[k] < 0 || index[k] >= length) { PyErr_SetString(PyExc_IndexError, "index out of range"); n = 0; break; }
  for (Size i = 0; i < n; i++) {
    const int64_t *from = INTS(0) + i * length;
    int64_t *to = INTS(2) + i * count;
    for (Size k = 0; k < count; k++) to[k] = from[index[k]];
  }
  DONE;
}

/* choose(mask, a, b, out): a where the mask (M, N) is set, else b (n, M, N), by bits: the mask is as good as random. */
KERNEL(c_choose) {
  OPEN(4, 3);
  Size count = b.views[0].len, n = count ? LENGTH(3) / count : 0;
  const char *mask = b.views[0].buf;
  for (Size i = 0; i < n; i++) {
    const int64_t *yes = INTS(1) + i * count, *no = INTS(2) + i * count;
    int64_t *restrict out = INTS(3) + i * count;
    for (Size k = 0; k < count; k++) out[k] = no[k] ^ ((yes[k] ^ no[k]) & -(int64_t)mask[k]);
  }
  DONE;
}

/* pairs(u, r1, r2, N): `distinct_pairs` from uniform numbers u (2, M, N). */
KERNEL(c_pairs) {
  OPEN(3, 1);
  Size N = WHOLE(3), count = LENGTH(1);
  const double *u = DOUBLES(0);
  for (Size l = 0, i = 0; l < count; l++) {
    Size first = (Size)(u[l] * (double)(N - 1)) + 1, second = (Size)(u[count + l] * (double)(N - 2)) + 1;
    second += second >= first;
    INTS(1)[l] = l + first - (i + first < N ? 0 : N);
    INTS(2)[l] = l + second - (i + second < N ? 0 : N);
    i = i + 1 < N ? i + 1 : 0;
  }
  DONE;
}

/* ---- small matrices over trailing batch axes: linalg.py and sigma_points.py ---- */

/* Members of a batch at a time. Not 512: rows of memory that begin 4096 bytes apart share a set of the cache. */
enum { CHUNK = 520 };
/* Components whose intermediate products fit the stack. */
enum { MOST = 36 };
enum { SHARED = 2 }; /* constant in a part of a batch whose other parts have constants of their own */

/* A matrix (rows, columns, *batch), or a vector (rows, *batch) as one column; strides count doubles. It is constant
   without a batch. */
typedef struct { double *at; Size rows, columns, row, column, batch; int constant; } Matrix;

/* Describe the memory v by M; false unless it has numbers of float64 and contiguous batch axes. */
static int as_matrix(const Py_buffer *v, int vector, Matrix *M) {
  int axes = vector ? 1 : 2;
  if (v->ndim < axes || !v->format || strcmp(v->format, "d")) return 0;
  Size expected = 8, batch = 1;
  for (int k = v->ndim - 1; k >= axes; k--) { /* the batch axes must be contiguous */
    if (v->strides[k] != expected && v->shape[k] != 1) return 0;
    expected *= v->shape[k];
    batch *= v->shape[k];
  }
  *M = (Matrix){v->buf, v->shape[0], vector ? 1 : v->shape[1], v->strides[0] / 8, vector ? 0 : v->strides[1] / 8,
                batch, v->ndim == axes};
  return 1;
}

/* Whether the axes after the first a_axes of a and after the first b_axes of b have equal lengths. */
static int same_batch(const Py_buffer *a, int a_axes, const Py_buffer *b, int b_axes) {
  if (a->ndim - a_axes != b->ndim - b_axes) return 0;
  for (int k = 0; k < a->ndim - a_axes; k++)
    if (a->shape[a_axes + k] != b->shape[b_axes + k]) return 0;
  return 1;
}

/* Open arrays with their strides; those from `written` on are written to. */
static int open_strided(Buffers *b, PyObject *const *args, Size given, int n, int written) {
  b->count = 0;
  if (given < n) { PyErr_SetString(PyExc_TypeError, "too few arguments"); return 0; }
  for (int i = 0; i < n; i++) {
    int wanted = PyBUF_STRIDES | PyBUF_FORMAT | (i < written ? 0 : PyBUF_WRITABLE);
    if (PyObject_GetBuffer(args[i], &b->views[i], wanted)) {
      release(b);
      return 0;
    }
    b->count++;
  }
  return 1;
}

#define OPEN_STRIDED(n, written) Buffers b; if (!open_strided(&b, args, given, n, written)) return NULL
#define ANSWER(done) do { int answer = (done); release(&b); return PyBool_FromLong(answer); } while (0)

/* A', a view of the same memory. */
static Matrix transposed(Matrix A) {
  return (Matrix){A.at, A.columns, A.rows, A.column, A.row, A.batch, A.constant};
}

/* Products of two constant matrices with so many terms are left to numpy, whose order depends on the layout. */
#define LAYOUT_TERMS 8

/* sum = a_0 c_0 + a_1 c_1 + ... of n members, from left to right; a_j is at a + j a_step, c_j at c + j c_step. Four terms are
   added in one loop, so that the sum stays in a register. */
WIDE static void sum_products(double *restrict sum, const double *a, Size a_step, const double *c, Size c_step, Size terms,
                              Size n) {
  const double *a_1 = a + a_step, *a_2 = a_1 + a_step, *c_1 = c + c_step, *c_2 = c_1 + c_step;
  Size first = terms % 4;
  if (!terms) memset(sum, 0, sizeof(double) * n);
  if (first == 1) for (Size l = 0; l < n; l++) sum[l] = a[l] * c[l];
  else if (first == 2) for (Size l = 0; l < n; l++) sum[l] = a[l] * c[l] + a_1[l] * c_1[l];
  else if (first == 3) for (Size l = 0; l < n; l++) sum[l] = a[l] * c[l] + a_1[l] * c_1[l] + a_2[l] * c_2[l];
  for (Size j = first; j < terms; j += 4) {
    const double *a_j[4], *c_j[4];
    for (Size i = 0; i < 4; i++) a_j[i] = a + (j + i) * a_step, c_j[i] = c + (j + i) * c_step;
    if (j)
      for (Size l = 0; l < n; l++)
        sum[l] = sum[l] + a_j[0][l] * c_j[0][l] + a_j[1][l] * c_j[1][l] + a_j[2][l] * c_j[2][l] + a_j[3][l] * c_j[3][l];
    else
      for (Size l = 0; l < n; l++)
        sum[l] = a_j[0][l] * c_j[0][l] + a_j[1][l] * c_j[1][l] + a_j[2][l] * c_j[2][l] + a_j[3][l] * c_j[3][l];
  }
}

/* out = A B for members from ... from + n of the batch. Zeros of a constant matrix are left out, but numpy's sums
   of the product of two constant matrices have all terms and begin with 0.0. */
WIDE static void multiply(const Matrix *A, const Matrix *B, const Matrix *out, Size from, Size n) {
  for (Size i = 0; i < A->rows; i++)
    for (Size k = 0; k < B->columns; k++) {
      double *restrict sum = out->at + i * out->row + k * out->column + from;
      if (A->constant && B->constant) {
        *sum = 0.0;
        for (Size j = 0; j < A->columns; j++)
          *sum += A->at[i * A->row + j * A->column] * B->at[j * B->row + k * B->column];
        continue;
      }
      if (!A->constant && !B->constant) {
        sum_products(sum, A->at + i * A->row + from, A->column, B->at + k * B->column + from, B->row, A->columns, n);
        continue;
      }
      int terms = 0;
      for (Size j = 0; j < A->columns; j++) {
        const double *a = A->at + i * A->row + j * A->column, *c = B->at + j * B->row + k * B->column;
        double factor = A->constant ? *a : *c;
        const double *of = A->constant ? c + from : a + from;
        if (factor == 0.0) continue;
        if (terms++) for (Size l = 0; l < n; l++) sum[l] += factor * of[l];
        else for (Size l = 0; l < n; l++) sum[l] = factor * of[l];
      }
      if (!terms) memset(sum, 0, sizeof(double) * n);
    }
}

/* The product of this chunk in memory of its own. */
static Matrix product_in(double *memory, const Matrix *A, const Matrix *B, Size from, Size n) {
  Matrix out = {memory - from, A->rows, B->columns, B->columns * CHUNK, CHUNK, 0, A->constant && B->constant};
  multiply(A, B, &out, from, n);
  return out;
}

/* P = (P + P') / 2 */
WIDE static void symmetrize(const Matrix *P, Size from, Size n) {
  for (Size i = 0; i < P->rows && P->rows > 1; i++)
    for (Size k = 0; k <= i; k++) {
      double *upper = P->at + k * P->row + i * P->column + from, *lower = P->at + i * P->row + k * P->column + from;
      for (Size l = 0; l < n; l++) upper[l] = lower[l] = 0.5 * (lower[l] + upper[l]);
    }
}

/* out = (F P F' + its transpose) / 2, by F P of this chunk, then F (F P)'. */
static void sandwich(const Matrix *F, const Matrix *P, const Matrix *out, Size from, Size n) {
  static double memory[MOST * CHUNK]; /* the interpreter's lock is held */
  Matrix turned = transposed(product_in(memory, F, P, from, n));
  multiply(F, &turned, out, from, n);
  symmetrize(out, from, n);
}

/* P += Q, of the batch or constant */
WIDE static void add(const Matrix *P, const Matrix *Q, Size from, Size n) {
  for (Size i = 0; i < P->rows; i++)
    for (Size k = 0; k < P->columns; k++) {
      double *restrict sum = P->at + i * P->row + k * P->column + from;
      const double *term = Q->at + i * Q->row + k * Q->column;
      if (Q->constant) for (Size l = 0; l < n; l++) sum[l] += *term;
      else for (Size l = 0; l < n; l++) sum[l] += term[from + l];
    }
}

/* product(A, B, out, vector): A B, or A x; False if an argument's memory has another form. */
KERNEL(c_product) {
  OPEN_STRIDED(3, 2);
  int axes = WHOLE(3) ? 1 : 2;
  Matrix A, B, out;
  if (!as_matrix(&b.views[0], 0, &A) || !as_matrix(&b.views[1], axes == 1, &B) || !as_matrix(&b.views[2], axes == 1, &out)
      || A.columns != B.rows || !(A.constant || B.constant || same_batch(&b.views[0], 2, &b.views[1], axes))
      || (A.constant && B.constant && A.columns >= LAYOUT_TERMS))
    ANSWER(0);
  for (Size from = 0; from < out.batch; from += CHUNK)
    multiply(&A, &B, &out, from, out.batch - from < CHUNK ? out.batch - from : CHUNK);
  ANSWER(1);
}

/* sandwich(F, P, out): (F P F' + its transpose) / 2. */
KERNEL(c_sandwich) {
  OPEN_STRIDED(3, 2);
  Matrix F, P, out;
  if (!as_matrix(&b.views[0], 0, &F) || !as_matrix(&b.views[1], 0, &P) || !as_matrix(&b.views[2], 0, &out)
      || F.rows * F.columns > MOST || F.columns != P.rows || P.columns != P.rows
      || (F.constant && P.constant && F.columns >= LAYOUT_TERMS)
      || !(F.constant || P.constant || same_batch(&b.views[0], 2, &b.views[1], 2)))
    ANSWER(0);
  for (Size from = 0; from < out.batch; from += CHUNK)
    sandwich(&F, &P, &out, from, out.batch - from < CHUNK ? out.batch - from : CHUNK);
  ANSWER(1);
}

/* Open P, H, R and two more matrices: the last two have the batch of P, H and R have it or are constant. */
static int as_update(const Buffers *b, Matrix *M) {
  for (int i = 0; i < 5; i++)
    if (!as_matrix(&b->views[i], 0, &M[i]) || M[i].rows * M[i].columns > MOST
        || !((M[i].constant && i < 3) || same_batch(&b->views[0], 2, &b->views[i], 2)))
      return 0;
  if (M[0].constant && (M[0].rows >= LAYOUT_TERMS || M[2].rows >= LAYOUT_TERMS)) return 0;
  return M[0].columns == M[0].rows && M[1].columns == M[0].rows && M[2].rows == M[1].rows && M[2].columns == M[1].rows;
}

/* S^-1 of one component or two, `inverse`. */
WIDE static void invert(const Matrix *S, const Matrix *out, Size from, Size n) {
  const double *first = S->at + from, *low = S->at + S->row + from, *last = low + S->column;
  double *inverse = out->at + from, *off = out->at + out->column + from, *off_low = out->at + out->row + from;
  for (Size l = 0; l < n; l++)
    if (S->rows == 1) inverse[l] = 1.0 / first[l];
    else {
      double ratio = low[l] / first[l], rest = last[l] - ratio * low[l];
      double d = 1.0 / (rest > 0.0 && first[l] > 0.0 ? rest : NAN);
      off[l] = off_low[l] = -ratio * d;
      inverse[l] = 1.0 / first[l] - ratio * off[l];
      off_low[out->column + l] = d;
    }
}

/* S = H P H' + R and K = P H' S^-1 of one or two measurements. */
static void gain(const Matrix *P, const Matrix *H, const Matrix *R, const Matrix *S, const Matrix *K, Size from, Size n) {
  static double HP_memory[MOST * CHUNK], inverse_memory[4 * CHUNK];
  Matrix PH = transposed(product_in(HP_memory, H, P, from, n));
  multiply(H, &PH, S, from, n);
  symmetrize(S, from, n);
  add(S, R, from, n);
  Matrix inverse = {inverse_memory - from, R->rows, R->rows, R->rows * CHUNK, CHUNK, 0, S->constant};
  invert(S, &inverse, from, n);
  multiply(&PH, &inverse, K, from, n);
}

/* gain(P, H, R, S, K): `gain` of kalman.py. */
KERNEL(c_gain) {
  OPEN_STRIDED(5, 3);
  Matrix M[5];
  if (!as_update(&b, M) || M[2].rows > 2) ANSWER(0);
  for (Size from = 0; from < M[0].batch; from += CHUNK)
    gain(&M[0], &M[1], &M[2], &M[3], &M[4], from, M[0].batch - from < CHUNK ? M[0].batch - from : CHUNK);
  ANSWER(1);
}

/* out = (I - K H) P (I - K H)' + K R K' */
WIDE static void joseph(const Matrix *P, const Matrix *H, const Matrix *R, const Matrix *K, const Matrix *out, Size from, Size n) {
  static double left_memory[MOST * CHUNK], noise_memory[MOST * CHUNK], second_memory[MOST * CHUNK];
  Size n_x = P->rows, n_z = R->rows;
  Matrix left = product_in(left_memory, K, H, from, n);
  for (Size i = 0; i < n_x; i++)
    for (Size k = 0; k < n_x; k++) {
      double *entry = left_memory + (i * n_x + k) * CHUNK;
      for (Size l = 0; l < n; l++) entry[l] = i == k ? -entry[l] + 1.0 : -entry[l];
    }
  sandwich(&left, P, out, from, n);
  int repeated = R->constant && !K->constant; /* over the batch, so that the zeros of R count as numpy's do */
  for (Size i = 0; i < n_z * n_z && repeated; i++)
    for (Size l = 0; l < n; l++) noise_memory[i * CHUNK + l] = R->at[i / n_z * R->row + i % n_z * R->column];
  Matrix repeat = {noise_memory - from, n_z, n_z, n_z * CHUNK, CHUNK, 0, 0};
  Matrix second = {second_memory - from, n_x, n_x, n_x * CHUNK, CHUNK, 0, K->constant};
  sandwich(K, repeated ? &repeat : R, &second, from, n);
  add(out, &second, from, n);
}

/* joseph(P, H, R, K, out): `_joseph` of kalman.py. */
KERNEL(c_joseph) {
  OPEN_STRIDED(5, 4);
  Matrix M[5];
  if (!as_update(&b, M) || M[3].rows != M[0].rows || M[3].columns != M[2].rows) ANSWER(0);
  for (Size from = 0; from < M[0].batch; from += CHUNK)
    joseph(&M[0], &M[1], &M[2], &M[3], &M[4], from, M[0].batch - from < CHUNK ? M[0].batch - from : CHUNK);
  ANSWER(1);
}

/* The lower Cholesky factor of this chunk, `_factor`; L is zero before. */
WIDE static void factor(const Matrix *P, const Matrix *L, double tolerance, Size from, Size n) {
  for (Size j = 0; j < P->rows; j++) {
    const double *variance = P->at + j * (P->row + P->column) + from;
    double pivot[CHUNK], products[CHUNK];
    double *root = L->at + j * (L->row + L->column) + from;
    for (Size i = j; i < P->rows; i++) {
      /* Step 1: P_ij less the products of the columns before. */
      const double *p = P->at + i * P->row + j * P->column + from;
      double *at = L->at + i * L->row + j * L->column + from, *value = i == j ? pivot : at;
      for (Size k = 0; k < j; k++) {
        const double *a = L->at + i * L->row + k * L->column + from, *c = L->at + j * L->row + k * L->column + from;
        if (k) for (Size l = 0; l < n; l++) products[l] += a[l] * c[l];
        else for (Size l = 0; l < n; l++) products[l] = a[l] * c[l];
      }
      for (Size l = 0; l < n; l++) value[l] = j ? p[l] - products[l] : p[l];
      /* Step 2: divide by the pivot's root. */
      if (i == j) for (Size l = 0; l < n; l++) root[l] = sqrt(pivot[l]);
      else for (Size l = 0; l < n; l++) at[l] /= root[l];
    }
    if (P->rows == 1 && tolerance == 0.0) continue; /* the root alone */
    /* Step 3: zeros where there is no variance, NaN where P is not definite. */
    for (Size i = j; i < P->rows; i++) {
      double *at = L->at + i * L->row + j * L->column + from;
      for (Size l = 0; l < n; l++) {
        double least = tolerance != 0.0 ? tolerance * variance[l] : 0.0;
        if (!(pivot[l] > least)) at[l] = variance[l] == 0.0 || fabs(pivot[l]) < least ? 0.0 : NAN;
      }
    }
  }
}

/* factor(P, L, tolerance) */
KERNEL(c_factor) {
  OPEN_STRIDED(2, 1);
  Matrix P, L;
  double tolerance = PyFloat_AsDouble(args[2]);
  if (!as_matrix(&b.views[0], 0, &P) || !as_matrix(&b.views[1], 0, &L) || P.constant) ANSWER(0);
  for (Size from = 0; from < P.batch; from += CHUNK)
    factor(&P, &L, tolerance, from, P.batch - from < CHUNK ? P.batch - from : CHUNK);
  ANSWER(1);
}

/* out = L^-1 b by forward substitution; L may be constant. As in numpy, zeros of a single L are left out. */
WIDE static void forward(const Matrix *L, const Matrix *b, const Matrix *out, Size from, Size n) {
  for (Size i = 0; i < L->rows; i++) {
    double *restrict row = out->at + i * out->row + from;
    memcpy(row, b->at + i * b->row + from, sizeof(double) * n);
    for (Size j = 0; j <= i; j++) {
      const double *factor = L->at + i * L->row + j * L->column, *y = out->at + j * out->row + from;
      if (L->constant) {
        double f = j == i ? 1.0 / *factor : *factor;
        if (j == i) for (Size l = 0; l < n; l++) row[l] *= f;
        else if (f != 0.0 || L->constant == SHARED) for (Size l = 0; l < n; l++) row[l] -= f * y[l];
      } else {
        factor += from;
        if (j == i) for (Size l = 0; l < n; l++) row[l] *= 1.0 / factor[l];
        else for (Size l = 0; l < n; l++) row[l] -= factor[l] * y[l];
      }
    }
  }
}

/* Describe the first two arguments, a triangle L of each batch member or of all, and vectors e; false if they do not fit. */
static int as_triangle(const Buffers *b, Matrix *L, Matrix *e) {
  return as_matrix(&b->views[0], 0, L) && as_matrix(&b->views[1], 1, e) && !e->constant && L->rows == e->rows
         && L->columns == L->rows
         && (L->constant || same_batch(&b->views[0], 2, &b->views[1], 1));
}

/* whiten(L, b, out): L^-1 b */
KERNEL(c_whiten) {
  OPEN_STRIDED(3, 2);
  Matrix L, e, out;
  if (!as_triangle(&b, &L, &e) || !as_matrix(&b.views[2], 1, &out)) ANSWER(0);
  for (Size from = 0; from < e.batch; from += CHUNK)
    forward(&L, &e, &out, from, e.batch - from < CHUNK ? e.batch - from : CHUNK);
  ANSWER(1);
}

/* out = the squares of L^-1 e, added up. */
WIDE static void mahalanobis(const Matrix *L, const Matrix *e, double *restrict out, Size from, Size n) {
  static double memory[MOST * CHUNK];
  Matrix white = {memory - from, L->rows, 1, CHUNK, 0, 0, 0};
  forward(L, e, &white, from, n);
  for (Size i = 0; i < L->rows; i++) {
    const double *row = memory + i * CHUNK;
    if (i) for (Size l = 0; l < n; l++) out[from + l] += row[l] * row[l];
    else for (Size l = 0; l < n; l++) out[from + l] = row[l] * row[l];
  }
}

/* mahalanobis(L, e, out) */
KERNEL(c_mahalanobis) {
  OPEN_STRIDED(3, 2);
  Matrix L, e;
  const Py_buffer *of_L = &b.views[0], *of_e = &b.views[1];
  Size parts = 1;
  if (of_L->ndim == 4 && of_L->shape[3] == 1 && of_e->ndim == 3 && of_L->shape[2] == of_e->shape[1]
      && as_matrix(of_L, 0, &L) && as_matrix(of_e, 1, &e) && L.rows == e.rows && L.columns == L.rows) {
    parts = L.batch; /* L (n, n, parts, 1): one for each part of e (n, parts, M) */
    L.constant = SHARED;
  } else if (!as_triangle(&b, &L, &e)) ANSWER(0);
  if (L.rows > MOST) ANSWER(0);
  for (Size part = 0; part < parts; part++, L.at++) {
    Size end = (part + 1) * (e.batch / parts);
    for (Size from = part * (e.batch / parts); from < end; from += CHUNK)
      mahalanobis(&L, &e, DOUBLES(2), from, end - from < CHUNK ? end - from : CHUNK);
  }
  ANSWER(1);
}

/* The lower factor of a constant 2 x 2 covariance: zeros where there is no variance, NaN where it is not definite. */
static void factor_two(const double *S, double *L) {
  double column[2] = {S[0], S[2]};
  L[1] = 0.0;
  for (int j = 0; j < 2; j++) {
    double root = column[j] > 0.0 * S[3 * j] ? sqrt(column[j]) : S[3 * j] == 0.0 ? 0.0 : NAN;
    L[3 * j] = root;
    if (!j) {
      L[2] = root > 0.0 ? S[2] / root : root;
      column[1] = S[3] - L[2] * L[2];
    }
  }
}

/* track(F, Q, numbers, H, R, means, covs, S, nu, nis, n, n_z, M): the Kalman filter of a constant sensor and a motion with F
   and Q number numbers[k] at step k, over all steps; `track` of all_steps_at_once.py. The first of means and covs is the prior; nu holds
   the measurements (steps, n_z, M). */
KERNEL(c_track) {
  OPEN(10, 5);
  Size n = WHOLE(10), n_z = WHOLE(11), M = WHOLE(12), steps = LENGTH(7) / (n_z * n_z);
  Matrix H = {DOUBLES(3), n_z, n, n, 1, 1, 1}, R = {DOUBLES(4), n_z, n_z, n_z, 1, 1, 1};
  static double predicted_memory[MOST], gain_memory[MOST], rows_memory[MOST], memory[MOST * CHUNK];
  Matrix predicted = {predicted_memory, n, n, n, 1, 1, 1}, K = {gain_memory, n, n_z, n_z, 1, 1, 1};
  for (Size k = 0; k < steps; k++) {
    Size of_motion = INTS(2)[k] * n * n;
    Matrix F = {DOUBLES(0) + of_motion, n, n, n, 1, 1, 1}, Q = {DOUBLES(1) + of_motion, n, n, n, 1, 1, 1};
    double *cov = DOUBLES(6) + k * n * n, *S_k = DOUBLES(7) + k * n_z * n_z, L_memory[4] = {0.0}, noise_memory[4];
    Matrix P = {cov, n, n, n, 1, 1, 1}, posterior = {cov + n * n, n, n, n, 1, 1, 1};
    Matrix S = {S_k, n_z, n_z, n_z, 1, 1, 1}, L = {L_memory, n_z, n_z, n_z, 1, 1, 1};
    Matrix before = {DOUBLES(5) + k * n * M, n, 1, M, 0, M, 0}, m = {before.at + n * M, n, 1, M, 0, M, 0};
    Matrix nu = {DOUBLES(8) + k * n_z * M, n_z, 1, M, 0, M, 0};
    double *restrict nis = DOUBLES(9) + k * M;
    /* Step 1: leave missing components (NaN, in all runs) out, `drop_missing`. */
    Matrix rows = {rows_memory, n_z, n, n, 1, 1, 1}, noise = {noise_memory, n_z, n_z, n_z, 1, 1, 1};
    int missing[2] = {isnan(nu.at[0]), n_z == 2 && isnan(nu.at[M])};
    for (Size i = 0; i < n_z; i++) {
      for (Size j = 0; j < n; j++) rows_memory[i * n + j] = missing[i] ? 0.0 : H.at[i * n + j];
      for (Size j = 0; j < n_z; j++)
        noise_memory[i * n_z + j] = missing[i] || missing[j] ? i == j : R.at[i * n_z + j];
    }
    /* Step 2: F P F' + Q, the gain and the posterior covariance, which no measurement enters. */
    sandwich(&F, &P, &predicted, 0, 1);
    add(&predicted, &Q, 0, 1);
    gain(&predicted, &rows, &noise, &S, &K, 0, 1);
    joseph(&predicted, &rows, &noise, &K, &posterior, 0, 1);
    if (n_z == 2) factor_two(S_k, L_memory);
    for (Size from = 0; from < M; from += CHUNK) {
      Size count = M - from < CHUNK ? M - from : CHUNK;
      /* Step 3: F m and nu = z - H F m, for now 0 where z is missing. */
      multiply(&F, &before, &m, from, count);
      product_in(memory, &H, &m, from, count);
      for (Size i = 0; i < n_z; i++)
        for (Size l = 0; l < count; l++)
          nu.at[i * M + from + l] = missing[i] ? 0.0 : nu.at[i * M + from + l] - memory[i * CHUNK + l];
      /* Step 4: m + K nu, and nu' S^-1 nu. */
      Matrix correction = product_in(memory, &K, &nu, from, count);
      add(&m, &correction, from, count);
      if (n_z == 2) mahalanobis(&L, &nu, nis, from, count);
      else for (Size l = from; l < from + count; l++) nis[l] = nu.at[l] * nu.at[l] / (S_k[0] > 0.0 ? S_k[0] : NAN);
    }
    for (Size i = 0; i < n_z; i++)
      for (Size l = 0; l < M && missing[i]; l++) nu.at[i * M + l] = NAN;
    for (Size l = 0; l < M && missing[0] && missing[n_z - 1]; l++) nis[l] = NAN;
  }
  DONE;
}

/* What is measured of a state: its components `rows`, or the range and azimuth from a place; `MeasuredByKernel`. */
typedef struct { Size n_z; int is_radar; const int64_t *rows; const double *place, *arctangents; double pi; } Sensor;

/* The measurements z (n_z) of n states x; the azimuth is in (-pi, pi]. */
static void measure(const Sensor *sensor, const Matrix *x, const Matrix *z, Size from, Size n) {
  if (!sensor->is_radar) {
    for (Size i = 0; i < sensor->n_z; i++)
      memcpy(z->at + i * z->row + from, x->at + sensor->rows[i] * x->row + from, sizeof(double) * n);
    return;
  }
  for (Size l = from; l < from + n; l++) {
    double px = x->at[l] - sensor->place[0], py = x->at[2 * x->row + l] - sensor->place[1];
    z->at[l] = sqrt(px * px + py * py);
    z->at[z->row + l] = arctan2_of(py, px, sensor->arctangents, sensor->pi);
  }
}

/* z - z_pred, the azimuth wrapped to (-pi, pi], `wrap_angle`. */
static inline double innovation_of(const Sensor *sensor, Size component, double z, double z_pred) {
  double difference = z - z_pred, turn = 2.0 * sensor->pi;
  if (!sensor->is_radar || component == 0 || (difference < sensor->pi && difference > -sensor->pi)) return difference;
  return difference - turn * ceil(difference / turn - 0.5);
}

/* The Jacobian H (2, n) of range and azimuth, `polar_jacobian`. */
static void polar_jacobian(const Sensor *sensor, const Matrix *x, const Matrix *H, Size from, Size n) {
  for (Size i = 0; i < 2; i++)
    for (Size j = 0; j < H->columns; j++) memset(H->at + i * H->row + j * H->column + from, 0, sizeof(double) * n);
  for (Size l = from; l < from + n; l++) {
    double px = x->at[l] - sensor->place[0], py = x->at[2 * x->row + l] - sensor->place[1];
    double square = px * px + py * py, r = sqrt(square);
    H->at[l] = px / r;
    H->at[2 * H->column + l] = py / r;
    H->at[H->row + l] = -py / square;
    H->at[H->row + 2 * H->column + l] = px / square;
  }
}

/* log_prob(logs, L, e, out, n log(2 pi) / 2): log N(e; 0, L L'), `zero_mean_log_prob`. */
KERNEL(c_log_prob) {
  OPEN_STRIDED(4, 3);
  Matrix L, e;
  Buffers of_triangle = {{b.views[1], b.views[2]}, 0};
  if (!as_triangle(&of_triangle, &L, &e) || L.rows != L.columns || L.rows * L.rows > MOST) ANSWER(0);
  const double *logs = DOUBLES(0), log_norm = PyFloat_AsDouble(args[4]);
  static double triangle[MOST * CHUNK], rows[MOST * CHUNK];
  Size entry = L.constant ? 1 : CHUNK;
  for (Size from = 0; from < e.batch; from += CHUNK) {
    Size n = e.batch - from < CHUNK ? e.batch - from : CHUNK, count = L.constant ? 1 : n;
    /* Step 1: e' P^-1 e / 2 as the sum of squares of (sqrt(2) L)^-1 e. */
    Matrix scaled = {L.constant ? triangle : triangle - from, L.rows, L.rows, L.rows * entry, entry, 0, L.constant};
    for (Size i = 0; i < L.rows; i++)
      for (Size j = 0; j <= i; j++) {
        const double *at = L.at + i * L.row + j * L.column + (L.constant ? 0 : from);
        double *to = triangle + (i * L.rows + j) * entry;
        for (Size l = 0; l < count; l++) to[l] = 1.4142135623730951 * at[l];
      }
    Matrix white = {rows - from, L.rows, 1, CHUNK, 0, 0, 0};
    forward(&scaled, &e, &white, from, n);
    for (Size i = 0; i < L.rows; i++)
      for (Size l = 0; l < n; l++) {
        double square = rows[i * CHUNK + l] * rows[i * CHUNK + l];
        rows[l] = i ? rows[l] + square : square;
      }
    /* Step 2: sqrt(det P) is the product of the diagonal of L. */
    double *restrict out = DOUBLES(3) + from, scale[CHUNK];
    for (Size i = 0; i < L.rows; i++) {
      const double *at = L.at + i * (L.row + L.column) + (L.constant ? 0 : from);
      for (Size l = 0; l < count; l++) {
        scale[l] = i ? scale[l] * at[l] : at[l];
        if (scale[l] < 0x1p-1000 || scale[l] > 0x1p1000) ANSWER(0); /* numpy keeps the exponent */
      }
    }
    for (Size l = 0; l < count; l++) scale[l] = -(log_of(scale[l], logs) + log_norm);
    if (L.constant) for (Size l = 0; l < n; l++) out[l] = scale[0] - rows[l];
    else for (Size l = 0; l < n; l++) out[l] = scale[l] - rows[l];
  }
  ANSWER(1);
}

/* cov += w (P + e e') with e = m - mean, a state's share in `combine`; w (n) are this chunk's. */
WIDE static void mix(const double *w, const Matrix *m, const Matrix *P, const Matrix *mean, const Matrix *cov, Size from, Size n) {
  for (Size i = 0; i < m->rows; i++)
    for (Size k = 0; k < m->rows; k++) {
      const double *m_i = m->at + i * m->row + from, *m_k = m->at + k * m->row + from;
      const double *p = P->at + i * P->row + k * P->column + (P->constant ? 0 : from);
      const double *mean_i = mean->at + i * mean->row + from, *mean_k = mean->at + k * mean->row + from;
      double *restrict sum = cov->at + i * cov->row + k * cov->column + from;
      for (Size l = 0; l < n; l++)
        sum[l] += w[l] * ((P->constant ? *p : p[l]) + (m_i[l] - mean_i[l]) * (m_k[l] - mean_k[l]));
    }
}

/* mix(w, m, P, mean, cov) */
KERNEL(c_mix) {
  OPEN_STRIDED(5, 4);
  Matrix m, P, mean, cov;
  if (!as_matrix(&b.views[1], 1, &m) || !as_matrix(&b.views[2], 0, &P) || !as_matrix(&b.views[3], 1, &mean)
      || !as_matrix(&b.views[4], 0, &cov) || strcmp(b.views[0].format, "d") || b.views[0].ndim != 1
      || b.views[0].strides[0] != 8 || b.views[0].shape[0] != m.batch || !(P.constant || P.batch == m.batch)
      || P.rows != m.rows || P.columns != m.rows)
    ANSWER(0);
  mix(DOUBLES(0), &m, &P, &mean, &cov, 0, m.batch);
  ANSWER(1);
}

enum { MODELS = 6 };

/* The moments of r Gaussians with weights w (r, CHUNK), `combine`. */
WIDE static void combine(double (*w)[CHUNK], const Matrix *m, const Matrix *P, Size r, const Matrix *mean, const Matrix *cov,
                    Size from, Size n) {
  for (Size a = 0; a < mean->rows; a++) {
    double *restrict sum = mean->at + a * mean->row + from;
    for (Size l = 0; l < n; l++) sum[l] = 0.0;
    for (Size i = 0; i < r; i++) {
      const double *m_i = m[i].at + a * m[i].row + from;
      for (Size l = 0; l < n; l++) sum[l] += w[i][l] * m_i[l];
    }
    for (Size c = 0; c < mean->rows; c++) memset(cov->at + a * cov->row + c * cov->column + from, 0, sizeof(double) * n);
  }
  for (Size i = 0; i < r; i++) mix(w[i], &m[i], &P[i], mean, cov, from, n);
}

/* interact(F, Q, numbers, H, R, transition, z, powers, exp constants, rows, place, arctangents, pi, means, covs, weights,
   predicted means, covs and weights, nu, S, nis, mean, cov, is_radar, r, n, n_z, M): the IMM of motions with F and Q number
   numbers[k] at step k and a constant sensor, or a radar without H, over all steps, `interact` of imm_steps_at_once.py. Axes of steps
   and runs come last; means, covs and weights begin with those before the first step. False if a likelihood is not finite. */
KERNEL(c_interact) {
  OPEN(24, 13);
  Size r = WHOLE(25), n = WHOLE(26), n_z = WHOLE(27), M = WHOLE(28), batch = LENGTH(6) / n_z, longer = batch + M;
  Size matrices = LENGTH(0) / (r * n * n);
  const Sensor sensor = {n_z, WHOLE(24) != 0, INTS(9), DOUBLES(10), DOUBLES(11), DOUBLES(12)[0]};
  const double *change = DOUBLES(5), *powers = DOUBLES(7), *c = DOUBLES(8);
  static double mixed_memory[MOST * CHUNK], mixed_cov_memory[MOST * CHUNK], gain_memory[MOST * CHUNK], memory[MOST * CHUNK];
  static double root_memory[4 * CHUNK], known_memory[2 * CHUNK], rows_memory[MOST * CHUNK], share[MODELS][CHUNK];
  static double nis[MODELS][CHUNK], scale[MODELS][CHUNK], weight[MODELS][CHUNK];
  static int exponent[MODELS][CHUNK];
  int finite = 1;
  for (Size k = 0; k < batch && finite; k += M) {
    const double *z = DOUBLES(6) + k;
    /* Missing components (NaN, in all runs) are left out, `drop_missing`. */
    int missing[2] = {isnan(z[0]), n_z == 2 && isnan(z[batch])}, nothing = missing[0] && missing[n_z - 1];
    double noise_memory[4];
    Matrix H = {DOUBLES(3), n_z, n, n, 1, 1, 1}, R = {DOUBLES(4), n_z, n_z, n_z, 1, 1, 1};
    Matrix rows = {rows_memory, n_z, n, n, 1, 1, 1}, noise = {noise_memory, n_z, n_z, n_z, 1, 1, 1};
    for (Size i = 0; i < n_z; i++) {
      for (Size j = 0; j < n && !sensor.is_radar; j++) rows_memory[i * n + j] = missing[i] ? 0.0 : H.at[i * n + j];
      for (Size j = 0; j < n_z; j++)
        noise_memory[i * n_z + j] = missing[i] || missing[j] ? i == j : R.at[i * n_z + j];
    }
    for (Size from = 0; from < M; from += CHUNK) {
      Size count = M - from < CHUNK ? M - from : CHUNK;
      Matrix m[MODELS], P[MODELS], m_after[MODELS], P_after[MODELS];
      for (Size j = 0; j < r; j++) {
        m[j] = (Matrix){DOUBLES(13) + j * n * longer + k, n, 1, longer, 0, longer, 0};
        P[j] = (Matrix){DOUBLES(14) + j * n * n * longer + k, n, n, n * longer, longer, longer, 0};
        m_after[j] = m[j], m_after[j].at += M;
        P_after[j] = P[j], P_after[j].at += M;
      }
      for (Size j = 0; j < r; j++) {
        /* Step 1: c_j = sum_i p_ij mu_i, mu_i|j = p_ij mu_i / c_j. */
        double *restrict predicted = DOUBLES(18) + j * batch + k + from;
        for (Size i = 0; i < r; i++) {
          const double *before = DOUBLES(15) + i * longer + k + from;
          for (Size l = 0; l < count; l++) {
            share[i][l] = change[i * r + j] * before[l];
            predicted[l] = i ? predicted[l] + share[i][l] : share[i][l];
          }
        }
        for (Size i = 0; i < r; i++)
          for (Size l = 0; l < count; l++) share[i][l] = predicted[l] > 0.0 ? share[i][l] / predicted[l] : i == j;
        /* Step 2: mix the states that model j starts from. */
        Matrix mixed = {mixed_memory - from, n, 1, CHUNK, 0, 0, 0};
        Matrix mixed_cov = {mixed_cov_memory - from, n, n, n * CHUNK, CHUNK, 0, 0};
        combine(share, m, P, r, &mixed, &mixed_cov, from, count);
        /* Step 3: predict, F m and F P F' + Q. */
        Size of_motion = (j * matrices + INTS(2)[k / M]) * n * n;
        Matrix F = {DOUBLES(0) + of_motion, n, n, n, 1, 1, 1}, Q = {DOUBLES(1) + of_motion, n, n, n, 1, 1, 1};
        Matrix m_p = {DOUBLES(16) + j * n * batch + k, n, 1, batch, 0, batch, 0};
        Matrix P_p = {DOUBLES(17) + j * n * n * batch + k, n, n, n * batch, batch, batch, 0};
        multiply(&F, &mixed, &m_p, from, count);
        sandwich(&F, &mixed_cov, &P_p, from, count);
        add(&P_p, &Q, from, count);
        /* Step 4: the innovation, which is 0 for the update where z is missing. A radar has H of each run. */
        if (sensor.is_radar) {
          Matrix z_pred = {memory - from, n_z, 1, CHUNK, 0, 0, 0};
          measure(&sensor, &m_p, &z_pred, from, count);
          rows = (Matrix){rows_memory - from, n_z, n, n * CHUNK, CHUNK, 0, 0};
          polar_jacobian(&sensor, &m_p, &rows, from, count);
          for (Size i = 0; i < n_z * n; i++)
            if (missing[i / n]) memset(rows_memory + i * CHUNK, 0, sizeof(double) * count);
        } else product_in(memory, &H, &m_p, from, count);
        for (Size i = 0; i < n_z; i++)
          for (Size l = 0; l < count; l++) {
            double innovation = innovation_of(&sensor, i, z[i * batch + from + l], memory[i * CHUNK + l]);
            DOUBLES(19)[(j * n_z + i) * batch + k + from + l] = innovation;
            known_memory[i * CHUNK + l] = missing[i] ? 0.0 : innovation;
          }
        /* Step 5: update. */
        Matrix S = {DOUBLES(20) + j * n_z * n_z * batch + k, n_z, n_z, n_z * batch, batch, batch, 0};
        Matrix K = {gain_memory - from, n, n_z, n_z * CHUNK, CHUNK, 0, 0}, nu = {known_memory - from, n_z, 1, CHUNK, 0, 0, 0};
        gain(&P_p, &rows, &noise, &S, &K, from, count);
        multiply(&K, &nu, &m_after[j], from, count);
        add(&m_after[j], &m_p, from, count);
        joseph(&P_p, &rows, &noise, &K, &P_after[j], from, count);
        /* Step 6: NIS and sqrt(det S), `nis_and_scale`. */
        Matrix L = {root_memory - from, n_z, n_z, n_z * CHUNK, CHUNK, 0, 0};
        memset(root_memory, 0, sizeof root_memory);
        factor(&S, &L, 0.0, from, count);
        mahalanobis(&L, &nu, nis[j] - from, from, count);
        for (Size l = 0; l < count; l++) {
          int more;
          scale[j][l] = frexp(root_memory[l], &exponent[j][l]);
          if (n_z == 2) {
            scale[j][l] = frexp(scale[j][l] * root_memory[3 * CHUNK + l], &more);
            exponent[j][l] += more;
          }
          finite &= fabs(nis[j][l]) < INFINITY && scale[j][l] > 0.0 && scale[j][l] < INFINITY;
        }
      }
      /* Step 7: mu_j ~ c_j N(nu_j; 0, S_j), `update_weights`, and the mean NIS. */
      double *mean_nis = DOUBLES(21) + k + from;
      for (Size l = 0; l < count; l++) {
        double least = INFINITY, sum = 0.0, mean = 0.0;
        int lowest = exponent[0][l];
        for (Size j = 0; j < r; j++) {
          if (DOUBLES(18)[j * batch + k + from + l] > 0.0 && nis[j][l] < least) least = nis[j][l];
          if (exponent[j][l] < lowest) lowest = exponent[j][l];
        }
        for (Size j = 0; j < r; j++) {
          double predicted = DOUBLES(18)[j * batch + k + from + l];
          double density = exp_of(-0.5 * (predicted > 0.0 ? nis[j][l] - least : 0.0), powers, c);
          double w = predicted / ldexp(scale[j][l], exponent[j][l] - lowest) * density, part = predicted * nis[j][l];
          weight[j][l] = w;
          sum = j ? sum + w : w;
          mean = j ? mean + part : part;
        }
        for (Size j = 0; j < r; j++) {
          weight[j][l] = nothing ? DOUBLES(18)[j * batch + k + from + l] : weight[j][l] / sum;
          DOUBLES(15)[j * longer + M + k + from + l] = weight[j][l];
          finite &= fabs(weight[j][l]) < INFINITY;
        }
        mean_nis[l] = nothing ? NAN : mean;
      }
      /* Step 8: the moments of the mixture. */
      Matrix mean = {DOUBLES(22) + k, n, 1, batch, 0, batch, 0}, cov = {DOUBLES(23) + k, n, n, n * batch, batch, batch, 0};
      combine(weight, m_after, P_after, r, &mean, &cov, from, count);
    }
  }
  ANSWER(finite);
}

/* Whether any of a is NaN, or infinite if that counts; None if the memory of a has another form. */
static PyObject *any(PyObject *const *args, Size given, int infinite) {
  Py_buffer view;
  if (given < 1 || PyObject_GetBuffer(args[0], &view, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT)) {
    PyErr_Clear();
    Py_RETURN_NONE;
  }
  const double *a = view.buf;
  int suitable = !strcmp(view.format, "d"), found = 0;
  Size length = suitable ? view.len / 8 : 0;
  if (infinite) for (Size i = 0; i < length; i++) found |= !(fabs(a[i]) < INFINITY);
  else found = any_nan(a, length);
  PyBuffer_Release(&view);
  if (!suitable) Py_RETURN_NONE;
  return PyBool_FromLong(found);
}

KERNEL(c_any_nan) { return any(args, given, 0); }
KERNEL(c_any_not_finite) { return any(args, given, 1); }

/* displaced(x, nu, out, T, K): positions and velocities x (4, M, N) one step on, given nu (2, M, N); `displaced`. */
KERNEL(c_displaced) {
  OPEN(3, 2);
  Size n = LENGTH(1) / 2;
  double T = PyFloat_AsDouble(args[3]), K = PyFloat_AsDouble(args[4]);
  for (int axis = 0; axis < 2; axis++) {
    const double *p = DOUBLES(0) + 2 * axis * n, *v = p + n, *nu = DOUBLES(1) + axis * n;
    double *restrict p_out = DOUBLES(2) + 2 * axis * n, *restrict v_out = p_out + n;
    for (Size i = 0; i < n; i++) p_out[i] = v[i] * T + p[i] + nu[i], v_out[i] = nu[i] * K + v[i];
  }
  DONE;
}

/* epanechnikov(square, e): e / sqrt(2 square + e'e) in place, `kernel_draws`. */
KERNEL(c_epanechnikov) {
  OPEN(2, 1);
  Size count = LENGTH(0);
  double *e = DOUBLES(1), root[CHUNK];
  for (Size from = 0; from < count; from += CHUNK) {
    Size n = count - from < CHUNK ? count - from : CHUNK;
    /* Step 1: the norm in n + 4 dimensions. */
    for (Size k = 0; k < n; k++) root[k] = DOUBLES(0)[from + k] * 2.0;
    for (Size i = from; i < LENGTH(1); i += count)
      for (Size k = 0; k < n; k++) root[k] += e[i + k] * e[i + k];
    for (Size k = 0; k < n; k++) root[k] = sqrt(root[k]);
    /* Step 2: divide each coordinate by it. */
    for (Size i = from; i < LENGTH(1); i += count)
      for (Size k = 0; k < n; k++) e[i + k] /= root[k];
  }
  DONE;
}

/* move(L, e, members, x, out, n): x + L e for a triangle per run and particles (n, M, N), of the members (M, N) of a
   mode or of all; `jitter_modes`. */
WIDE KERNEL(c_move) {
  OPEN(5, 4);
  Size n = WHOLE(5), M = n > 0 ? LENGTH(0) / (n * n) : 0, N = M ? LENGTH(1) / (n * M) : 0;
  for (Size m = 0; m < M; m++)
    for (Size from = 0; from < N; from += CHUNK) {
      Size size = N - from < CHUNK ? N - from : CHUNK;
      const char *member = b.views[2].len ? (const char *)b.views[2].buf + m * N + from : NULL;
      for (Size i = 0; i < n; i++) {
        Size at = (i * M + m) * N + from;
        const double *x = DOUBLES(3) + at;
        double *restrict out = DOUBLES(4) + at;
        /* Step 1: L e */
        for (Size j = 0; j <= i; j++) {
          double factor = DOUBLES(0)[(i * n + j) * M + m];
          const double *e = DOUBLES(1) + (j * M + m) * N + from;
          if (j) for (Size k = 0; k < size; k++) out[k] += factor * e[k];
          else for (Size k = 0; k < size; k++) out[k] = factor * e[k];
        }
        /* Step 2: x + L e, or x + 0.0 of a particle that is no member. */
        if (member) for (Size k = 0; k < size; k++) out[k] = of_bits(bits_of(out[k]) & -(int64_t)member[k]) + x[k];
        else for (Size k = 0; k < size; k++) out[k] += x[k];
      }
    }
  DONE;
}

/* One rotation of `_rotate` that makes A_pq zero, of matrices (n, n, M) in place; return whether any of M needs it. */
static int rotate(double *A, double *V, Size n, Size M, Size p, Size q, double rounding, double *work) {
  double *restrict a = work, *restrict b = a + M, *restrict off = b + M, *restrict t = off + M, *restrict c = t + M, *restrict s = c + M;
  int any = 0;
  memcpy(a, A + (p * n + p) * M, sizeof(double) * M);
  memcpy(b, A + (q * n + q) * M, sizeof(double) * M);
  memcpy(off, A + (p * n + q) * M, sizeof(double) * M);
  for (Size l = 0; l < M; l++) any |= fabs(off[l]) > rounding * sqrt(fabs(a[l] * b[l]));
  if (!any) return 0;
  for (Size l = 0; l < M; l++) {
    double theta = (b[l] - a[l]) / (2.0 * off[l]);
    double tangent = (theta < 0.0 ? -1.0 : 1.0) / (fabs(theta) + sqrt(theta * theta + 1.0));
    t[l] = fabs(off[l]) > rounding * sqrt(fabs(a[l] * b[l])) ? tangent : 0.0;
    c[l] = 1.0 / sqrt(t[l] * t[l] + 1.0);
    s[l] = t[l] * c[l];
  }
  /* Rows of A and columns of V, then the columns of A, which are its rows. */
  for (Size i = 0; i < n; i++) {
    double *restrict x = V + (i * n + p) * M, *restrict y = V + (i * n + q) * M;
    for (Size l = 0; l < M; l++) { double u = x[l], v = y[l]; x[l] = c[l] * u - s[l] * v; y[l] = s[l] * u + c[l] * v; }
  }
  for (Size i = 0; i < n; i++) {
    double *restrict x = A + (p * n + i) * M, *restrict y = A + (q * n + i) * M;
    for (Size l = 0; l < M; l++) { double u = x[l], v = y[l]; x[l] = c[l] * u - s[l] * v; y[l] = s[l] * u + c[l] * v; }
  }
  for (Size i = 0; i < n; i++) {
    if (i == p || i == q) continue;
    memcpy(A + (i * n + p) * M, A + (p * n + i) * M, sizeof(double) * M);
    memcpy(A + (i * n + q) * M, A + (q * n + i) * M, sizeof(double) * M);
  }
  for (Size l = 0; l < M; l++) {
    int turn = fabs(off[l]) > rounding * sqrt(fabs(a[l] * b[l]));
    A[(p * n + p) * M + l] = a[l] - t[l] * off[l];
    A[(q * n + q) * M + l] = b[l] + t[l] * off[l];
    A[(p * n + q) * M + l] = A[(q * n + p) * M + l] = turn ? 0.0 : off[l];
  }
  return 1;
}

/* eigen(A, V, n, sweeps, rounding): Jacobi rotations of A and V (n, n, batch) in place. */
KERNEL(c_eigen) {
  OPEN(2, 0);
  Size n = WHOLE(2), sweeps = WHOLE(3), M = n > 0 ? LENGTH(0) / (n * n) : 0;
  double rounding = PyFloat_AsDouble(args[4]), *work = malloc(sizeof(double) * 6 * (M + 1));
  int rotated = work != NULL;
  if (!work) PyErr_NoMemory();
  for (Size sweep = 0; sweep < sweeps && rotated; sweep++) {
    rotated = 0;
    for (Size p = 0; p < n; p++)
      for (Size q = p + 1; q < n; q++) rotated |= rotate(DOUBLES(0), DOUBLES(1), n, M, p, q, rounding, work);
  }
  free(work);
  DONE;
}

/* Sums over P points of values (m, P, batch), one for each row of out. */
static void weighted(const double *weights, const double *values, Size P, Size batch, const Matrix *out) {
  for (Size i = 0; i < out->rows; i++) {
    double *restrict sum = out->at + i * out->row;
    for (Size from = 0; from < batch; from += CHUNK)
      for (Size p = 0; p < P; p++) {
        const double *x = values + (i * P + p) * batch, w = weights[p];
        Size to = batch - from < CHUNK ? batch : from + CHUNK;
        if (p) for (Size l = from; l < to; l++) sum[l] += w * x[l];
        else for (Size l = from; l < to; l++) sum[l] = w * x[l];
      }
  }
}

/* weighted(weights, values, out): sums over points of values (m, P, batch). */
KERNEL(c_weighted) {
  OPEN(3, 2);
  Size P = LENGTH(0), m = WHOLE(3), batch = m > 0 ? LENGTH(2) / m : 0;
  Matrix out = {DOUBLES(2), m, 1, batch, 0, batch, 0};
  weighted(DOUBLES(0), DOUBLES(1), P, batch, &out);
  DONE;
}

/* Weighted sums of (a - a_mean) (c - c_mean)' over P points of a (rows of out, P, batch) and c (columns, P, batch). */
static void cross(const double *weights, const double *a, const Matrix *a_mean, const double *c, const Matrix *c_mean, Size P,
                  Size batch, const Matrix *out) {
  for (Size i = 0; i < out->rows; i++)
    for (Size j = 0; j < out->columns; j++) {
      double *restrict sum = out->at + i * out->row + j * out->column;
      const double *A = a_mean->at + i * a_mean->row, *C = c_mean->at + j * c_mean->row;
      for (Size from = 0; from < batch; from += CHUNK)
        for (Size p = 0; p < P; p++) {
          const double *x = a + (i * P + p) * batch, *y = c + (j * P + p) * batch, w = weights[p];
          Size to = batch - from < CHUNK ? batch : from + CHUNK;
          if (p) for (Size l = from; l < to; l++) sum[l] += w * ((x[l] - A[l]) * (y[l] - C[l]));
          else for (Size l = from; l < to; l++) sum[l] = w * ((x[l] - A[l]) * (y[l] - C[l]));
        }
    }
}

/* cross(weights, a, a_mean, c, c_mean, out, r, s): weighted sums of (a - a_mean) (c - c_mean)' over points;
   a (r, P, batch), c (s, P, batch). */
KERNEL(c_cross) {
  OPEN(6, 5);
  Size P = LENGTH(0), r = WHOLE(6), s = WHOLE(7), batch = P && r > 0 ? LENGTH(1) / (r * P) : 0;
  Matrix a_mean = {DOUBLES(2), r, 1, batch, 0, batch, 0}, c_mean = {DOUBLES(4), s, 1, batch, 0, batch, 0};
  Matrix out = {DOUBLES(5), r, s, s * batch, batch, batch, 0};
  cross(DOUBLES(0), DOUBLES(1), &a_mean, DOUBLES(3), &c_mean, P, batch, &out);
  DONE;
}

/* sigma_points(mean, root, out, scale): the mean, and the mean plus and minus the scaled columns of its root. */
KERNEL(c_sigma_points) {
  OPEN_STRIDED(3, 2);
  Matrix m, L;
  double scale = PyFloat_AsDouble(args[3]);
  if (!as_matrix(&b.views[0], 1, &m) || !as_matrix(&b.views[1], 0, &L) || L.rows != m.rows || L.columns != m.rows
      || !(L.constant || same_batch(&b.views[0], 1, &b.views[1], 2)))
    ANSWER(0);
  for (Size i = 0; i < m.rows; i++) {
    const double *mean = m.at + i * m.row;
    double *center = DOUBLES(2) + i * (2 * m.rows + 1) * m.batch;
    memcpy(center, mean, sizeof(double) * m.batch);
    for (Size k = 0; k < m.rows; k++) {
      const double *at = L.at + i * L.row + k * L.column;
      double *restrict above = center + (1 + k) * m.batch, *restrict below = above + m.rows * m.batch;
      for (Size l = 0; l < m.batch; l++) {
        double step = scale * (L.constant ? *at : at[l]);
        above[l] = mean[l] + step;
        below[l] = mean[l] - step;
      }
    }
  }
  ANSWER(1);
}

/* The distance of a sigma point; like `root`, NaN for an infinite variance and 0.0 for -0.0. */
static inline double spread(double scale, double variance) {
  return scale * ((variance == INFINITY ? NAN : sqrt(variance)) + 0.0);
}

/* scalar_points(mean, P, x, scale): x (3, batch), the mean of a scalar and the points on both sides of it.
   False also for a mean of -0.0, of which the other points are +0.0. */
KERNEL(c_scalar_points) {
  OPEN_STRIDED(3, 2);
  Matrix m, P;
  double scale = PyFloat_AsDouble(args[3]);
  int negative_zero = 0;
  if (!as_matrix(&b.views[0], 1, &m) || !as_matrix(&b.views[1], 0, &P)
      || !(P.constant || same_batch(&b.views[0], 1, &b.views[1], 2)))
    ANSWER(0);
  double *restrict x = DOUBLES(2), *restrict above = x + m.batch, *restrict below = above + m.batch;
  for (Size l = 0; l < m.batch; l++) negative_zero |= bits_of(m.at[l]) == INT64_MIN;
  for (Size l = 0; l < m.batch; l++) below[l] = P.constant ? *P.at : P.at[l];
  for (Size l = 0; l < m.batch; l++) {
    double step = spread(scale, below[l]);
    x[l] = m.at[l];
    above[l] = m.at[l] + step;
    below[l] = m.at[l] - step;
  }
  ANSWER(!negative_zero);
}

/* scalar_noise(moved, Q, f, scale): f (5, batch) of the moved points (3, batch), and f(mean) + v and f(mean) - v. */
KERNEL(c_scalar_noise) {
  OPEN(3, 2);
  const double *moved = DOUBLES(0), v = spread(PyFloat_AsDouble(args[3]), *DOUBLES(1));
  double *restrict f = DOUBLES(2);
  Size batch = LENGTH(2) / 5;
  for (Size l = 0; l < 3 * batch; l++) f[l] = moved[l] + 0.0;
  for (Size l = 0; l < batch; l++) f[3 * batch + l] = moved[l] + v, f[4 * batch + l] = moved[l] - v;
  DONE;
}

/* scalar_update(weights, cov_weights, f, h, R, z, m, P, nu, S, scale): posterior, innovation of z (M) and its
   variance by the points f of scalar_noise and h (5, batch) of them; False if an innovation is NaN. */
WIDE KERNEL(c_scalar_update) {
  OPEN(10, 6);
  const double *f = DOUBLES(2), *h = DOUBLES(3), n = spread(PyFloat_AsDouble(args[10]), *DOUBLES(4));
  double *mean = DOUBLES(6), *cov = DOUBLES(7), *nu = DOUBLES(8), *S_out = DOUBLES(9);
  Size batch = LENGTH(6), runs = LENGTH(5), N = runs ? batch / runs : 0;
  int known = 1;
  /* Of the points' order, center, x, v, n above and x, v, n below: the row of f, and the noise n. */
  static const int row[7] = {0, 1, 3, 0, 2, 4, 0};
  const double noise[7] = {0.0, 0.0, 0.0, n, 0.0, 0.0, -n};
  double w[7], w_cov[7];
  memcpy(w, DOUBLES(0), sizeof w);
  memcpy(w_cov, DOUBLES(1), sizeof w_cov);
  for (Size r = 0; r < runs; r++)
    for (Size i = 0; i < N; i++) nu[r * N + i] = DOUBLES(5)[r];
  INDEPENDENT
  for (Size l = 0; l < batch; l++) {
    double moved[7], relative[7], m = 0.0, z_mean = 0.0, P = 0.0, S = 0.0, C = 0.0;
    /* Step 1: measurements relative to the center, and both means. */
    for (int p = 0; p < 7; p++) {
      moved[p] = f[row[p] * batch + l];
      relative[p] = h[row[p] * batch + l] - h[l] + noise[p];
      m = p ? m + w[p] * moved[p] : w[p] * moved[p];
      z_mean = p ? z_mean + w[p] * relative[p] : w[p] * relative[p];
    }
    /* Step 2: P of the state, S of the measurement, C of both. */
    for (int p = 0; p < 7; p++) {
      double dx = moved[p] - m, dz = relative[p] - z_mean;
      double xx = w_cov[p] * (dx * dx), zz = w_cov[p] * (dz * dz), xz = w_cov[p] * (dx * dz);
      P = p ? P + xx : xx, S = p ? S + zz : zz, C = p ? C + xz : xz;
    }
    /* Step 3: K = C / S, m + K nu, P - K S K. */
    double K = C * (1.0 / S), innovation = nu[l] - (h[l] + z_mean);
    nu[l] = innovation;
    S_out[l] = S;
    mean[l] = K * innovation + m;
    cov[l] = P - K * (K * S);
  }
  for (Size l = 0; l < batch; l++) known &= nu[l] == nu[l];
  ANSWER(known);
}

/* m + K nu and P - K S K' with K = C S^-1, of one or two measurements. */
static void condition(const Matrix *m, const Matrix *P, const Matrix *nu, const Matrix *C, const Matrix *S, const Matrix *mean,
                      const Matrix *cov, Size from, Size n) {
  static double gain[MOST * CHUNK], inverse_memory[4 * CHUNK];
  Matrix inverse = {inverse_memory - from, S->rows, S->rows, S->rows * CHUNK, CHUNK, 0, 0};
  invert(S, &inverse, from, n);
  Matrix K = product_in(gain, C, &inverse, from, n);
  multiply(&K, nu, mean, from, n);
  add(mean, m, from, n);
  sandwich(&K, S, cov, from, n);
  for (Size i = 0; i < P->rows; i++)
    for (Size k = 0; k < P->rows; k++) {
      double *restrict out = cov->at + i * cov->row + k * cov->column + from;
      const double *p = P->at + i * P->row + k * P->column + from;
      for (Size l = 0; l < n; l++) out[l] = p[l] - out[l];
    }
}

/* condition(m, P, nu, C, S, mean, cov): `condition` of kalman.py. */
KERNEL(c_condition) {
  OPEN_STRIDED(7, 5);
  Matrix M[7];
  for (int i = 0; i < 7; i++) {
    int vector = i == 0 || i == 2 || i == 5;
    if (!as_matrix(&b.views[i], vector, &M[i]) || M[i].constant || M[i].rows * M[i].columns > MOST
        || !same_batch(&b.views[0], 1, &b.views[i], vector ? 1 : 2))
      ANSWER(0);
  }
  Matrix m = M[0], P = M[1], nu = M[2], C = M[3], S = M[4], mean = M[5], cov = M[6];
  if (S.rows > 2 || S.columns != S.rows || C.columns != S.rows || nu.rows != S.rows || C.rows != m.rows
      || P.rows != m.rows || P.columns != m.rows)
    ANSWER(0);
  for (Size from = 0; from < m.batch; from += CHUNK)
    condition(&m, &P, &nu, &C, &S, &mean, &cov, from, m.batch - from < CHUNK ? m.batch - from : CHUNK);
  ANSWER(1);
}

/* ---- all steps of a nonlinear filter: all_steps_at_once.py ---- */

enum { FEW = 512, MOST_AUGMENTED = 14, MOST_POINTS = 29 }; /* runs; components of state and noises; their sigma points */

/* The arrays of `filter_steps`. Axes of steps and runs come last; means and covs begin with those before the first step. */
typedef struct {
  Matrix F, Q, R;
  Sensor sensor;
  const double *z;
  double *means, *covs, *predicted_means, *predicted_covs, *nu, *S, *nis;
  Size n, n_z, M, batch;
} Arrays;

/* One step of the arrays: Gaussians of n components and measurements of n_z, in M runs. */
typedef struct { Matrix before, cov_before, mean, cov, predicted, predicted_cov, nu, S; const double *z; double *nis; } Single;

/* The step whose runs begin at place k of the axes of steps and runs. */
static Single single_step(const Arrays *a, Size k) {
  Size n = a->n, n_z = a->n_z, batch = a->batch, longer = batch + a->M;
  Single s = {
    .before = {a->means + k, n, 1, longer, 0, a->M, 0}, .cov_before = {a->covs + k, n, n, n * longer, longer, a->M, 0},
    .mean = {a->means + k + a->M, n, 1, longer, 0, a->M, 0},
    .cov = {a->covs + k + a->M, n, n, n * longer, longer, a->M, 0},
    .predicted = {a->predicted_means + k, n, 1, batch, 0, a->M, 0},
    .predicted_cov = {a->predicted_covs + k, n, n, n * batch, batch, a->M, 0},
    .nu = {a->nu + k, n_z, 1, batch, 0, a->M, 0}, .S = {a->S + k, n_z, n_z, n_z * batch, batch, a->M, 0},
    .z = a->z + k, .nis = a->nis + k};
  return s;
}

/* Whether the first n members of the batch have finite entries only. */
static int is_finite(const Matrix *A, Size n) {
  int finite = 1;
  for (Size i = 0; i < A->rows; i++)
    for (Size j = 0; j < A->columns; j++) {
      const double *at = A->at + i * A->row + j * A->column;
      for (Size l = 0; l < n; l++) finite &= fabs(at[l]) < INFINITY;
    }
  return finite;
}

/* nu = z - z_pred, NaN where z is missing, and what the update takes of it, 0 there. */
static void innovate(const Arrays *a, const Single *s, const Matrix *z_pred, const Matrix *known) {
  for (Size i = 0; i < a->n_z; i++)
    for (Size l = 0; l < a->M; l++) {
      double nu = innovation_of(&a->sensor, i, s->z[i * a->batch + l], z_pred->at[i * z_pred->row + l]);
      s->nu.at[i * s->nu.row + l] = nu;
      known->at[i * known->row + l] = nu == nu ? nu : 0.0;
    }
}

/* NIS of the known innovations, NaN where all components are missing; `Innovation.nis`. */
static void score(const Arrays *a, const Single *s, const Matrix *known) {
  static double memory[4 * FEW];
  Size M = a->M;
  if (a->n_z == 1)
    for (Size l = 0; l < M; l++) s->nis[l] = known->at[l] * known->at[l] / (s->S.at[l] > 0.0 ? s->S.at[l] : NAN);
  else {
    Matrix L = {memory, 2, 2, 2 * M, M, M, 0};
    memset(memory, 0, sizeof memory);
    factor(&s->S, &L, 0.0, 0, M);
    mahalanobis(&L, known, s->nis, 0, M);
  }
  for (Size l = 0; l < M; l++) {
    int missing = 1;
    for (Size i = 0; i < a->n_z; i++) missing &= isnan(s->nu.at[i * s->nu.row + l]);
    if (missing) s->nis[l] = NAN;
  }
}

/* A step of the UKF, `augmented_step`; false if a state is not finite, or a covariance has lost its digits. */
static int unscented_step(const Arrays *a, const Single *s, const double *w, const double *w_cov, double scale) {
  static double P_memory[MOST_AUGMENTED * MOST_AUGMENTED * FEW], L_memory[MOST_AUGMENTED * MOST_AUGMENTED * FEW];
  static double points[MOST_AUGMENTED * MOST_POINTS * FEW], moved_memory[6 * MOST_POINTS * FEW], z_memory[2 * MOST_POINTS * FEW];
  static double mean_memory[2 * FEW], pred_memory[2 * FEW], known_memory[2 * FEW], C_memory[12 * FEW];
  Size n = a->n, n_z = a->n_z, M = a->M, size = 2 * n + n_z, P = 2 * size + 1;
  /* Step 1: points of (x, v, n), of mean (m, 0, 0) and covariance diag(P, Q, R). */
  Matrix augmented = {P_memory, size, size, size * M, M, M, 0}, L = {L_memory, size, size, size * M, M, M, 0};
  memset(P_memory, 0, sizeof(double) * size * size * M);
  for (Size i = 0; i < n; i++)
    for (Size j = 0; j < n; j++) {
      double *of_state = P_memory + (i * size + j) * M, *of_noise = P_memory + ((n + i) * size + n + j) * M;
      memcpy(of_state, s->cov_before.at + i * s->cov_before.row + j * s->cov_before.column, sizeof(double) * M);
      for (Size l = 0; l < M; l++) of_noise[l] = a->Q.at[i * n + j];
    }
  for (Size i = 0; i < n_z; i++)
    for (Size j = 0; j < n_z; j++)
      for (Size l = 0; l < M; l++) P_memory[((2 * n + i) * size + 2 * n + j) * M + l] = a->R.at[i * n_z + j];
  for (int singular = 0; singular < 2; singular++) {
    memset(L_memory, 0, sizeof(double) * size * size * M);
    factor(&augmented, &L, singular ? 1e-14 : 0.0, 0, M);
    if (is_finite(&L, M)) break;
    if (singular) return 0;
  }
  for (Size i = 0; i < size; i++) {
    double *center = points + i * P * M;
    if (i < n) memcpy(center, s->before.at + i * s->before.row, sizeof(double) * M);
    else memset(center, 0, sizeof(double) * M);
    for (Size k = 0; k < size; k++)
      for (Size l = 0; l < M; l++) {
        double step = scale * L_memory[(i * size + k) * M + l];
        center[(1 + k) * M + l] = center[l] + step;
        center[(1 + size + k) * M + l] = center[l] - step;
      }
  }
  /* Step 2: f(x) + v, and its moments. */
  Matrix x = {points, n, 1, P * M, 0, P * M, 0}, moved = {moved_memory, n, 1, P * M, 0, P * M, 0};
  multiply(&a->F, &x, &moved, 0, P * M);
  for (Size i = 0; i < n * P * M; i++) moved_memory[i] += points[n * P * M + i];
  weighted(w, moved_memory, P, M, &s->predicted);
  cross(w_cov, moved_memory, &s->predicted, moved_memory, &s->predicted, P, M, &s->predicted_cov);
  if (!is_finite(&s->predicted, M) || !is_finite(&s->predicted_cov, M)) return 0;
  /* Step 3: h(f(x) + v) + n relative to the center, and its moments. */
  Matrix z = {z_memory, n_z, 1, P * M, 0, P * M, 0}, z_mean = {mean_memory, n_z, 1, M, 0, M, 0};
  Matrix z_pred = {pred_memory, n_z, 1, M, 0, M, 0}, known = {known_memory, n_z, 1, M, 0, M, 0};
  Matrix C = {C_memory, n, n_z, n_z * M, M, M, 0};
  measure(&a->sensor, &moved, &z, 0, P * M);
  for (Size i = 0; i < n_z; i++) {
    double *row = z_memory + i * P * M;
    memcpy(pred_memory + i * M, row, sizeof(double) * M);
    for (Size p = 0; p < P; p++)
      for (Size l = 0; l < M; l++)
        row[p * M + l] = innovation_of(&a->sensor, i, row[p * M + l], pred_memory[i * M + l])
                         + points[((2 * n + i) * P + p) * M + l];
  }
  weighted(w, z_memory, P, M, &z_mean);
  cross(w_cov, z_memory, &z_mean, z_memory, &z_mean, P, M, &s->S);
  cross(w_cov, moved_memory, &s->predicted, z_memory, &z_mean, P, M, &C);
  for (Size i = 0; i < n_z * M; i++) pred_memory[i] += mean_memory[i];
  innovate(a, s, &z_pred, &known);
  /* Step 4: leave missing components out of S and C, `drop_missing`; condition. */
  for (Size i = 0; i < n_z; i++)
    for (Size l = 0; l < M; l++) {
      if (!isnan(s->nu.at[i * s->nu.row + l])) continue;
      for (Size j = 0; j < n; j++) C_memory[(j * n_z + i) * M + l] = 0.0;
      for (Size j = 0; j < n_z; j++)
        s->S.at[i * s->S.row + j * s->S.column + l] = s->S.at[j * s->S.row + i * s->S.column + l] = i == j;
    }
  condition(&s->predicted, &s->predicted_cov, &known, &C, &s->S, &s->mean, &s->cov, 0, M);
  score(a, s, &known);
  /* Step 5: a difference of covariances that has lost its digits is left to numpy. */
  Matrix root = {L_memory, n, n, n * M, M, M, 0};
  memset(L_memory, 0, sizeof(double) * n * n * M);
  factor(&s->cov, &root, 0.0, 0, M);
  if (!is_finite(&root, M)) return 0;
  for (Size i = 0; i < n; i++)
    for (Size l = 0; l < M; l++) {
      double variance = s->predicted_cov.at[i * (s->predicted_cov.row + s->predicted_cov.column) + l];
      double left = s->cov.at[i * (s->cov.row + s->cov.column) + l], pivot = L_memory[(i * n + i) * M + l];
      if (left < 1e-10 * variance || !(pivot * pivot >= 1e-12 * variance)) return 0;
    }
  return is_finite(&s->mean, M) && is_finite(&s->cov, M);
}

/* A step of the EKF of a radar, `extended_step`; false if a state is not finite. */
static int extended_step(const Arrays *a, const Single *s) {
  static double z_memory[2 * FEW], known_memory[2 * FEW], H_memory[12 * FEW], R_memory[4 * FEW], K_memory[12 * FEW];
  Size n = a->n, n_z = a->n_z, M = a->M;
  /* Step 1: F m, F P F' + Q. */
  multiply(&a->F, &s->before, &s->predicted, 0, M);
  sandwich(&a->F, &s->cov_before, &s->predicted_cov, 0, M);
  add(&s->predicted_cov, &a->Q, 0, M);
  if (!is_finite(&s->predicted, M) || !is_finite(&s->predicted_cov, M)) return 0;
  /* Step 2: nu = z - h(m), and H; missing components are left out, `drop_missing`. */
  Matrix z_pred = {z_memory, n_z, 1, M, 0, M, 0}, known = {known_memory, n_z, 1, M, 0, M, 0};
  Matrix H = {H_memory, n_z, n, n * M, M, M, 0}, R = {R_memory, n_z, n_z, n_z * M, M, M, 0};
  measure(&a->sensor, &s->predicted, &z_pred, 0, M);
  innovate(a, s, &z_pred, &known);
  polar_jacobian(&a->sensor, &s->predicted, &H, 0, M);
  for (Size i = 0; i < n_z; i++)
    for (Size l = 0; l < M; l++) {
      int missing = isnan(s->nu.at[i * s->nu.row + l]);
      for (Size j = 0; j < n && missing; j++) H_memory[(i * n + j) * M + l] = 0.0;
      for (Size j = 0; j < n_z; j++)
        R_memory[(i * n_z + j) * M + l] = missing || isnan(s->nu.at[j * s->nu.row + l]) ? i == j : a->R.at[i * n_z + j];
    }
  /* Step 3: update. */
  Matrix K = {K_memory, n, n_z, n_z * M, M, M, 0};
  gain(&s->predicted_cov, &H, &R, &s->S, &K, 0, M);
  multiply(&K, &known, &s->mean, 0, M);
  add(&s->mean, &s->predicted, 0, M);
  joseph(&s->predicted_cov, &H, &R, &K, &s->cov, 0, M);
  score(a, s, &known);
  return is_finite(&s->mean, M) && is_finite(&s->cov, M);
}

/* filter_steps(F, Q, numbers, R, weights, cov_weights, rows, place, arctangents, pi, z, means, covs, predicted means and covs,
   nu, S, nis, scale, is_radar, n, n_z, M): the UKF, or without weights the EKF of a radar, over all steps, of a motion with
   F and Q number numbers[k] at step k; `filter_steps` of all_steps_at_once.py. False if a step is left to numpy. */
KERNEL(c_filter_steps) {
  OPEN(18, 11);
  double scale = PyFloat_AsDouble(args[18]);
  Size n = WHOLE(20), n_z = WHOLE(21), M = WHOLE(22);
  int done = 1, has_points = LENGTH(4) > 0;
  Arrays a = {
    .F = {DOUBLES(0), n, n, n, 1, 1, 1}, .Q = {DOUBLES(1), n, n, n, 1, 1, 1}, .R = {DOUBLES(3), n_z, n_z, n_z, 1, 1, 1},
    .sensor = {n_z, WHOLE(19) != 0, INTS(6), DOUBLES(7), DOUBLES(8), DOUBLES(9)[0]}, .z = DOUBLES(10), .means = DOUBLES(11),
    .covs = DOUBLES(12), .predicted_means = DOUBLES(13), .predicted_covs = DOUBLES(14), .nu = DOUBLES(15), .S = DOUBLES(16),
    .nis = DOUBLES(17), .n = n, .n_z = n_z, .M = M, .batch = LENGTH(10) / n_z};
  for (Size k = 0; k < a.batch && done; k += M) {
    Size of_motion = INTS(2)[k / M] * n * n;
    a.F.at = DOUBLES(0) + of_motion;
    a.Q.at = DOUBLES(1) + of_motion;
    Single s = single_step(&a, k);
    done = has_points ? unscented_step(&a, &s, DOUBLES(4), DOUBLES(5), scale) : extended_step(&a, &s);
  }
  ANSWER(done);
}

/* ---- text: csv_writer.py ---- */

/* The shortest text of x among those of so many significant digits, as Python's repr writes it; to be freed. */
static char *shortened(double x, int digits) {
  char *text = PyOS_double_to_string(x, 'g', digits, 0, NULL);
  if (!text || (strchr(text, '.') && !strchr(text, 'e'))) return text;
  double rounded = PyOS_string_to_double(text, NULL, NULL);
  PyMem_Free(text);
  return PyOS_double_to_string(rounded, 'r', 0, Py_DTSF_ADD_DOT_0, NULL);
}

/* Powers of ten that are exact numbers. */
static const double TENS[] = {1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16,
                              1e17, 1e18, 1e19, 1e20, 1e21, 1e22};
enum { MOST_TENS = 22, MOST_DIGITS = 15, LONGEST_NUMBER = 32 };

/* a / 10^-k or a 10^k as a whole number, rounded as its exact value is: to the nearest, a half to the even one. */
static int64_t rounded_decimal(double a, int k) {
  if (k >= 0) {
    /* product + rest is a 10^k without rounding. */
    double product = a * TENS[k], rest = fma(a, TENS[k], -product);
    int64_t below = (int64_t)product;
    double beyond_half = product - (double)below - 0.5;
    return below + (beyond_half > -rest || (beyond_half == -rest && below % 2));
  }
  int64_t below = (int64_t)(a / TENS[-k]);
  double rest = fma(-(double)below, TENS[-k], a);
  if (rest < 0.0) {
    below--;
    rest += TENS[-k];
  }
  double beyond_half = 2.0 * rest - TENS[-k];
  return below + (beyond_half > 0.0 || (beyond_half == 0.0 && below % 2));
}

/* Write the digits of n before `end`; return their beginning. */
static char *digits_before(char *end, int64_t n) {
  do *--end = (char)('0' + n % 10);
  while (n /= 10);
  return end;
}

/* Write the text of `shortened` for a number of moderate size, and the number that is read back from it. Return the
   length of the text, or 0 for a number that is left to `shortened`. */
static Size moderate_decimal(double x, int digits, char *text, double *as_read) {
  double a = fabs(x);
  if (digits > MOST_DIGITS || !(a >= 1e-15 && a < 1e15)) return 0;
  /* Step 1: the exponent of the first digit, 10^first <= a < 10^(first + 1). */
  int first = -1;
  while (first < 14 && a >= TENS[first + 1]) first++;
  while (first < 0 && a * TENS[-first] < 1.0) first--;
  /* Step 2: the digits as one whole number; 9.99...9 rounds to a further digit. */
  int k = digits - 1 - first;
  if (k > MOST_TENS) return 0;
  int64_t decimal = rounded_decimal(a, k);
  if (decimal < (int64_t)TENS[digits - 1] || decimal > (int64_t)TENS[digits]) return 0;
  /* Both are exact, so that the quotient or product is rounded once, as a text is that is read. */
  double value = k >= 0 ? (double)decimal / TENS[k] : (double)decimal * TENS[-k];
  *as_read = x < 0.0 ? -value : value;
  char reversed[LONGEST_NUMBER], *end = reversed + LONGEST_NUMBER, *to = text;
  if (x < 0.0) *to++ = '-';
  /* Step 3: below 10^-4 one digit, the others behind a point, and the exponent. Zeros at the end are not written. */
  if (a < 1e-4 && value < 1e-4) {
    if (decimal == (int64_t)TENS[digits]) first++;
    while (decimal % 10 == 0) decimal /= 10;
    char *start = digits_before(end, decimal);
    *to++ = *start++;
    if (start < end) *to++ = '.';
    memcpy(to, start, (size_t)(end - start));
    to += end - start;
    memcpy(to, "e-", 2);
    to[2] = (char)('0' - first / 10);
    to[3] = (char)('0' - first % 10);
    return to + 4 - text;
  }
  /* Else all digits, and at least one behind the point. */
  for (; k > 1 && decimal % 10 == 0; k--) decimal /= 10;
  for (; k < 1; k++) decimal *= 10;
  char *start = digits_before(end, decimal);
  while (end - start <= k) *--start = '0';
  Size whole = end - start - k;
  memcpy(to, start, (size_t)whole);
  to += whole;
  *to++ = '.';
  memcpy(to, end - k, (size_t)k);
  return to + k - text;
}

/* numbered_rows(values, as_read, digits, head, middle): the bytes of a row for each value, head, number of the row,
   middle, value; writes to as_read the numbers that are read back from these rows. */
KERNEL(c_numbered_rows) {
  OPEN(2, 1);
  const double *x = DOUBLES(0);
  double *as_read = DOUBLES(1);
  Size n = LENGTH(0), head_length, middle_length, length = 0;
  int digits = (int)WHOLE(2), done = 1;
  char *head, *middle, text[LONGEST_NUMBER], number[LONGEST_NUMBER];
  if (PyBytes_AsStringAndSize(args[3], &head, &head_length) || PyBytes_AsStringAndSize(args[4], &middle, &middle_length)) {
    release(&b);
    return NULL;
  }
  char *rows = PyMem_Malloc((size_t)n * (size_t)(head_length + middle_length + 2 * LONGEST_NUMBER) + 1), *end = rows;
  for (Size i = 0; rows && i < n; i++) {
    /* A number that equals the one before has its text. */
    if (i && bits_of(x[i]) == bits_of(x[i - 1])) {
      as_read[i] = as_read[i - 1];
    } else if (!(length = moderate_decimal(x[i], digits, text, &as_read[i]))) {
      char *shortest = shortened(x[i], digits);
      if (!shortest) { done = 0; break; }
      as_read[i] = PyOS_string_to_double(shortest, NULL, NULL);
      length = (Size)strlen(shortest);
      memcpy(text, shortest, (size_t)length);
      PyMem_Free(shortest);
    }
    memcpy(end, head, (size_t)head_length);
    end += head_length;
    char *start = digits_before(number + LONGEST_NUMBER, i);
    memcpy(end, start, (size_t)(number + LONGEST_NUMBER - start));
    end += number + LONGEST_NUMBER - start;
    memcpy(end, middle, (size_t)middle_length);
    end += middle_length;
    memcpy(end, text, (size_t)length);
    end += length;
    *end++ = '\n';
  }
  PyObject *result = rows && done ? PyBytes_FromStringAndSize(rows, end - rows) : PyErr_NoMemory();
  PyMem_Free(rows);
  release(&b);
  return result;
}

#define METHOD(name) {#name, (PyCFunction)(void (*)(void))c_##name, METH_FASTCALL, NULL}
static PyMethodDef methods[] = {
  METHOD(exp), METHOD(log), METHOD(gamma_log_density), METHOD(log_prob),
  METHOD(cos_sin), METHOD(arctan2), METHOD(line_of_sight), METHOD(normals), METHOD(erlang), METHOD(total),
  METHOD(dot), METHOD(window_sums), METHOD(normalize), METHOD(moments),
  METHOD(ancestors), METHOD(select), METHOD(choose), METHOD(pairs),
  METHOD(product), METHOD(sandwich), METHOD(gain), METHOD(joseph), METHOD(factor), METHOD(eigen), METHOD(whiten),
  METHOD(mahalanobis), METHOD(track), METHOD(mix), METHOD(interact), METHOD(any_nan), METHOD(any_not_finite),
  METHOD(displaced), METHOD(epanechnikov), METHOD(move), METHOD(weighted), METHOD(cross), METHOD(sigma_points),
  METHOD(scalar_points), METHOD(scalar_noise), METHOD(scalar_update), METHOD(condition), METHOD(filter_steps),
  METHOD(numbered_rows), {NULL}};
static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, "_compiled", "Kernels of core/ in C.", -1, methods};
PyMODINIT_FUNC PyInit__compiled(void) {
  PyObject *m = PyModule_Create(&module);
  if (m && PyModule_AddStringConstant(m, "source", SOURCE)) { Py_DECREF(m); return NULL; }
  return m;
}
