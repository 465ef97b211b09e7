// The sums of eager.py, which says what they mean, for columns first..last-1 of a slab of v.
// A tile of columns and a chunk of rows, side by side in memory or copied there (transposed, padded
// with zeros to whole vectors, what is taken off them removed), and all sums of it while it is in
// the cache: so no column knows its place, its neighbours or the number of threads.
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <cstring>

#if defined(__AVX512F__)
#define BYTES 64
#elif defined(__AVX__)
#define BYTES 32
#else
#define BYTES 16
#endif
#define UNROLL _Pragma("GCC unroll 16")

struct Slab {
  const void* v;
  int64_t row_stride, column_stride, columns;
  const void *taken_rows, *taken_coefficients, *scale;  // (t, J), (J, P), (P,), or null
  int64_t taken_count;
};
struct Pieces {
  const int64_t* at;  // low, high, block of each
  int64_t count;
};
struct Moments {
  Pieces pieces;
  const void* weights;  // (R - 1, t)
  int64_t weight_stride, rows, count;
  double centre;
  const double* known;  // (pieces, R): the sums of order 0
  double* totals;       // (R, K, P)
  void* of_blocks;      // (S, R, K, P) or null
};
struct Lines {
  Pieces pieces;
  const void* weights;  // (R, t)
  int64_t weight_stride, rows;
  double *sums, *squares, *smallest, *largest;  // (B, R, P); (B, P), (P,), (P,) or null
};

namespace {
// Rows that are summed before they are added to the sum of a piece: few enough that float32 sums
// of equal terms keep their digits, and that a chunk stays in the first cache.
constexpr int CHUNK = 32;
constexpr int GROUP = 5;  // rows of weights whose sums stay in registers

template <class T>
struct Vector {
  typedef T type __attribute__((vector_size(BYTES)));
  static constexpr int lanes = BYTES / sizeof(T);
};
template <class T>
using V = typename Vector<T>::type;
template <class T>
inline V<T> load(const T* p) {
  V<T> v;
  memcpy(&v, p, BYTES);
  return v;
}
template <class T>
inline void store(T* p, V<T> v) {
  memcpy(p, &v, BYTES);
}

// In whole vectors of doubles: compilers take wider ones apart number by number, through memory.
constexpr int D = Vector<double>::lanes;
template <class T, class F>
inline void exactly(V<T> v, F use) {
  constexpr int count = Vector<T>::lanes / D;
  typedef T Part __attribute__((vector_size(D * sizeof(T))));
  Part part[count];
  memcpy(part, &v, BYTES);
  UNROLL for (int i = 0; i < count; i++) use(i, __builtin_convertvector(part[i], V<double>));
}

// Where to work: freed with the call, aligned to cache lines.
template <class T>
struct Scratch {
  T* at;
  explicit Scratch(size_t n) : at((T*)aligned_alloc(64, (n * sizeof(T) + 63) / 64 * 64)) {}
  ~Scratch() { free(at); }
};

// What is taken off one tile of columns: coefficients (J, W) and scale (W), padded with zeros.
template <class T>
void take_tile(const Slab& s, long left, int n, int W, T* out) {
  long J = s.taken_count;
  std::fill(out, out + (J + 1) * W, T(0));
  for (long j = 0; j < J; j++)
    memcpy(out + j * W, (const T*)s.taken_coefficients + j * s.columns + left, n * sizeof(T));
  for (int i = 0; i < n; i++) out[J * W + i] = s.scale ? ((const T*)s.scale)[left + i] : T(1);
}

template <class T>
struct Chunk {
  const T* at;
  long stride;  // of its rows
};

// Rows t..t+rows-1 of columns left..left+n-1, W wide: where they lie, if that will do, else copied
// to `out`, whose columns n..W-1 stay as they are (zero).
template <class T>
Chunk<T> form_chunk(const Slab& s, long t, int rows, long left, int n, int W, const T* taken,
                    T* out) {
  constexpr int N = Vector<T>::lanes;
  const T* v = (const T*)s.v + t * s.row_stride + left * s.column_stride;
  if (s.column_stride == 1 && n == W && !s.taken_rows) return {v, s.row_stride};
  if (s.column_stride == 1)
    for (int i = 0; i < rows; i++) memcpy(out + i * W, v + i * s.row_stride, n * sizeof(T));
  else
    for (int i = 0; i < rows; i++)
      for (int j = 0; j < n; j++) out[i * W + j] = v[i * s.row_stride + j * s.column_stride];
  if (!s.taken_rows) return {out, W};
  const long J = s.taken_count;
  for (int i = 0; i < rows; i += 4) {
    const T* row[4];  // the last of fewer than four rows is done again
    T* to[4];
    for (int k = 0; k < 4; k++) {
      row[k] = (const T*)s.taken_rows + (t + std::min(i + k, rows - 1)) * J;
      to[k] = out + std::min(i + k, rows - 1) * W;
    }
    for (int j = 0; j < W; j += N) {
      V<T> a[4];
      UNROLL for (int k = 0; k < 4; k++) a[k] = load(to[k] + j) * load(taken + J * W + j);
      for (long c = 0; c < J; c++) {
        V<T> b = load(taken + c * W + j);
        UNROLL for (int k = 0; k < 4; k++) a[k] -= row[k][c] * b;
      }
      UNROLL for (int k = 0; k < 4; k++) store(to[k] + j, a[k]);
    }
  }
  return {out, W};
}

// The chunk after this one, to be fetched while this one is summed.
template <class T>
const T* ahead(const Slab& s, long t, long left, long* stride) {
  *stride = s.column_stride == 1 ? s.row_stride : 0;
  return (const T*)s.v + (*stride ? (t + CHUNK) * s.row_stride + left : 0);
}

// Orders up to `summed` are summed as they are; of T_{m+n} = 2 T_m T_n - T_{|m-n|} only T_m T_n is
// summed for the orders above (n = m or m - 1), which halves the recurrence and its chain.
inline int summed(int count) { return (count / 2 + 3) / 4 * 4; }

// acc[k][r][j] += those sums over the rows, Q rows at once; R = 0: any number of weights.
template <class T, int R, int Q>
void add_orders(Chunk<T> v, int W, int rows, const T* w, const Moments& m, T* acc,
                const T* next, long stride) {
  constexpr int N = Vector<T>::lanes;
  const T c = m.centre;
  const int half = summed(m.count), all = R ? R : m.rows;
  const long along = m.weight_stride;
  for (int t = 0; t < rows; t += Q)
    for (int j = 0; j < W; j += N) {
      V<T> x2[Q], p[Q], q[Q];
      UNROLL for (int i = 0; i < Q; i++) {
        V<T> a = load(v.at + (t + i) * v.stride + j);
        a = a > -a ? a : -a;
        __builtin_prefetch(next + (t + i) * stride + j);
        x2[i] = (T(2) * a - T(2) * c) / (a + c);
        q[i] = x2[i] * T(0.5);
        p[i] = V<T>{} + T(1);
      }
      auto add = [&](T* to, auto f) __attribute__((always_inline)) {
        V<T> s = f(0);
        UNROLL for (int i = 1; i < Q; i++) s += f(i);
        store(to, load(to) + s);
        UNROLL for (int r = 1; r < all; r++) {
          V<T> b = load(to + r * W);
          UNROLL for (int i = 0; i < Q; i++) b += w[(r - 1) * along + t + i] * f(i);
          store(to + r * W, b);
        }
      };
      const long order = (long)all * W;
      T *to = acc + order + j, *product = acc + (half + 1) * order + j;
      auto step = [&](V<T>* before, V<T>* now, bool products) __attribute__((always_inline)) {
        add(to, [&](int i) { return now[i]; });
        to += order;
        if (products) {
          add(product, [&](int i) { return before[i] * now[i]; });
          add(product + order, [&](int i) { return now[i] * now[i]; });
          product += 2 * order;
        }
        UNROLL for (int i = 0; i < Q; i++) before[i] = x2[i] * now[i] - before[i];
      };
      for (int k = 0; k < half / 2; k += 2) step(p, q, false), step(q, p, false);
      for (int k = 0; k < half / 2; k += 2) step(p, q, true), step(q, p, true);
    }
}

template <class T, int R>
void moments(const Slab& s, const Moments& m, long left, int n, int W, const T* taken, T* chunk) {
  const int K = m.count, all = m.rows, half = summed(K);
  const size_t size = (size_t)(2 * half + 1) * all * W;
  Scratch<T> acc(size), piece(size);
  Scratch<double> total((size_t)K * all * W);
  std::fill(total.at, total.at + (size_t)K * all * W, 0.0);
  for (long g = 0; g < m.pieces.count; g++) {
    const int64_t* p = m.pieces.at + 3 * g;
    std::fill(piece.at, piece.at + size, T(0));
    for (long t = p[0]; t < p[1]; t += CHUNK) {
      const int rows = std::min<long>(CHUNK, p[1] - t), four = rows - rows % 4;
      const T* w = (const T*)m.weights + t;
      std::fill(acc.at, acc.at + size, T(0));
      const Chunk<T> v = form_chunk(s, t, rows, left, n, W, taken, chunk);
      const Chunk<T> tail = {v.at + four * v.stride, v.stride};
      long stride;
      const T* next = ahead<T>(s, t, left, &stride);
      add_orders<T, R, 4>(v, W, four, w, m, acc.at, next, stride);
      add_orders<T, R, 1>(tail, W, rows - four, w + four, m, acc.at, next + four * stride, stride);
      for (size_t i = 0; i < size; i++) piece.at[i] += acc.at[i];
    }
    for (int r = 0; r < all; r++)
      for (int k = 0; k < K; k++) {
        const double known = m.known[g * all + r];
        const T* first_order = piece.at + ((size_t)all + r) * W;
        const T* from = piece.at + ((size_t)k * all + r) * W;
        double* to = total.at + ((size_t)r * K + k) * W;
        T* part = m.of_blocks ? (T*)m.of_blocks + ((p[2] * all + r) * K + k) * s.columns + left
                              : nullptr;
        for (int j = 0; j < n; j++) {
          double x = from[j];
          if (k > half) x = 2 * x - (k % 2 ? first_order[j] : known);
          // 3 * 2**19 has 2**-32 as its last digit: the sum is rounded there, half to even.
          x = k ? (x + 1572864.0) - 1572864.0 : known;
          to[j] += x;
          if (part) part[j] += T(x);
        }
      }
  }
  for (long i = 0; i < (long)all * K; i++)
    for (int j = 0; j < n; j++) m.totals[i * s.columns + left + j] += total.at[i * W + j];
}

// piece[r][j] += sums of v over a chunk under R rows of weights and, with S, of v^2; extremes.
template <class T, int R, bool S>
void add_rows(Chunk<T> v, int W, int rows, const T* w, long along, double* piece, T* low, T* high,
              const T* next, long stride) {
  constexpr int N = Vector<T>::lanes, A = R + S;
  for (int j = 0; j < W; j += 2 * N) {
    V<T> a[2 * A] = {}, small[2], large[2];
    UNROLL for (int h = 0; h < 2; h++)
      small[h] = load(low + j + h * N), large[h] = load(high + j + h * N);
    for (int i = 0; i < rows; i++)
      UNROLL for (int h = 0; h < 2; h++) {
        const V<T> x = load(v.at + i * v.stride + j + h * N);
        UNROLL for (int r = 0; r < R; r++) a[2 * r + h] += w[r * along + i] * x;
        if (!S) continue;
        __builtin_prefetch(next + i * stride + j + h * N);
        a[2 * R + h] += x * x;
        small[h] = x < small[h] ? x : small[h];
        large[h] = x > large[h] ? x : large[h];
      }
    UNROLL for (int h = 0; h < 2; h++)
      store(low + j + h * N, small[h]), store(high + j + h * N, large[h]);
    UNROLL for (int k = 0; k < 2 * A; k++) {
      double* sum = piece + k / 2 * W + j + k % 2 * N;
      exactly<T>(a[k], [&](int i, V<double> x) { store(sum + i * D, load(sum + i * D) + x); });
    }
  }
}
template <class T, bool S>
constexpr decltype(&add_rows<T, 0, S>) ROWS[GROUP + 1] = {
    add_rows<T, 0, S>, add_rows<T, 1, S>, add_rows<T, 2, S>,
    add_rows<T, 3, S>, add_rows<T, 4, S>, add_rows<T, 5, S>};

template <class T>
void lines(const Slab& s, const Lines& l, long left, int n, int W, const T* taken, T* chunk) {
  Scratch<double> piece((l.rows + 1) * W);
  Scratch<T> low(W), high(W);
  std::fill(low.at, low.at + W, T(1) / T(0));
  std::fill(high.at, high.at + W, -T(1) / T(0));
  // The first rows, of which there are three for one tone, share their registers with the squares.
  const long first = l.squares ? std::min<long>(l.rows, GROUP - 2) : 0;
  for (long g = 0; g < l.pieces.count; g++) {
    const int64_t* p = l.pieces.at + 3 * g;
    std::fill(piece.at, piece.at + (l.rows + 1) * W, 0.0);
    for (long t = p[0]; t < p[1]; t += CHUNK) {
      const int rows = std::min<long>(CHUNK, p[1] - t);
      const Chunk<T> v = form_chunk(s, t, rows, left, n, W, taken, chunk);
      long stride;
      const T *next = ahead<T>(s, t, left, &stride), *w = (const T*)l.weights + t;
      const long along = l.weight_stride;
      // The squares lie behind the first rows, and the other rows behind them.
      if (l.squares)
        ROWS<T, true>[first](v, W, rows, w, along, piece.at, low.at, high.at, next, stride);
      for (long r = first; r < l.rows; r += GROUP)
        ROWS<T, false>[std::min<long>(GROUP, l.rows - r)](
            v, W, rows, w + r * along, along, piece.at + (r + (l.squares != nullptr)) * W,
            low.at, high.at, next, stride);
    }
    for (long r = 0; r < l.rows; r++) {
      const double* from = piece.at + (r + (l.squares && r >= first)) * W;
      for (int j = 0; j < n; j++) l.sums[(p[2] * l.rows + r) * s.columns + left + j] += from[j];
    }
    for (int j = 0; l.squares && j < n; j++)
      l.squares[p[2] * s.columns + left + j] += piece.at[first * W + j];
  }
  for (int j = 0; l.smallest && j < n; j++)
    l.smallest[left + j] = std::min(l.smallest[left + j], (double)low.at[j]);
  for (int j = 0; l.largest && j < n; j++)
    l.largest[left + j] = std::max(l.largest[left + j], (double)high.at[j]);
}

// All sums of columns first..last-1, tile by tile, while a tile is in the cache.
template <class T>
void add(const Slab& s, const Lines* of, long count, const Moments* m, long first, long last) {
  // Running sums must stay in the first cache: narrower tiles where there are many.
  const int most = (m && m->count * m->rows > 64 ? 128 : 256) / sizeof(T);
  const int two = 2 * Vector<T>::lanes;
  const int W = std::min<long>(most, (last - first + two - 1) / two * two);
  Scratch<T> chunk(CHUNK * W), taken((s.taken_count + 1) * W);
  for (long left = first; left < last; left += W) {
    const int n = std::min<long>(W, last - left);
    std::fill(chunk.at, chunk.at + CHUNK * W, T(0));
    if (s.taken_rows) take_tile(s, left, n, W, taken.at);
    for (long i = 0; i < count; i++) lines<T>(s, of[i], left, n, W, taken.at, chunk.at);
    if (m)
      (m->rows == 1 ? moments<T, 1> : m->rows == 3 ? moments<T, 3> : moments<T, 0>)(
          s, *m, left, n, W, taken.at, chunk.at);
  }
}

// Averages of v over cells, of rows from..to-1: runs of neighbouring columns (first, count, cell),
// at most RUN of them in the precision of v.
constexpr long RUN = 256;
template <class T>
void cells(const Slab& s, const int64_t* runs, int64_t run_count, const double* shares,
           int64_t cell_count, T* out, int64_t from, int64_t to) {
  constexpr int N = Vector<T>::lanes;
  Scratch<double> sums(cell_count);
  V<T> lane;
  for (int i = 0; i < N; i++) lane[i] = i;
  for (long t = from; t < to; t++) {
    std::fill(sums.at, sums.at + cell_count, 0.0);
    for (long r = 0; r < run_count; r++) {
      const T* const row = (const T*)s.v + t * s.row_stride;
      const T* v = row + runs[3 * r];
      for (long left = runs[3 * r + 1]; left > 0; left -= RUN, v += RUN) {
        const long n = std::min(left, RUN), whole = n - n % N;
        V<T> wide = {};
        for (long j = 0; j < whole; j += N) wide += load(v + j);
        if (whole < n) {  // the run's last columns, beside others that are taken for zero
          T last[N] = {};
          const bool others = v + whole + N <= row + s.columns;
          if (!others) memcpy(last, v + whole, (n - whole) * sizeof(T));
          wide += lane < T(n - whole) ? load(others ? v + whole : last) : V<T>{};
        }
        V<double> sum = {};
        exactly<T>(wide, [&](int, V<double> x) { sum += x; });
        double found = 0;
        for (int i = 0; i < D; i++) found += sum[i];
        sums.at[runs[3 * r + 2]] += found;
      }
    }
    for (long c = 0; c < cell_count; c++) out[t * cell_count + c] = T(sums.at[c] * shares[c]);
  }
}

}  // namespace

#define EXPORTED(T, name)                                                                      \
  extern "C" void add_##name(const Slab* s, const Lines* l, int64_t count, const Moments* m,   \
                             int64_t from, int64_t to) {                                       \
    add<T>(*s, l, count, m, from, to);                                                         \
  }                                                                                            \
  extern "C" void cells_##name(const Slab* s, const int64_t* runs, int64_t n,                  \
                               const double* shares, int64_t count, T* out, int64_t from,      \
                               int64_t to) {                                                   \
    cells<T>(*s, runs, n, shares, count, out, from, to);                                       \
  }
EXPORTED(float, float32)
EXPORTED(double, float64)
