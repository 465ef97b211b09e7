// Sums of Chebyshev functions of |v|, defined by torch_sums of nodes.py.
//
// A tile of columns stays in the first cache, with all its sums; four samples at once share what is loaded. Of the
// orders above H = K/2 only products are summed, since T_{m+n} = 2 T_m T_n - T_{|m-n|}: that halves the recurrence.
// No column knows its place, its neighbours or the number of threads, so its bits do not depend on them.
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
#define UNROLL _Pragma("GCC unroll 8")

struct Layout {
  int64_t slab_stride, row_stride, column_stride;  // of v, (G, L, N), in elements
  int64_t slabs, rows, length, count, columns;     // G, R, L, K, N
};

namespace {
constexpr int ROWS = 32;  // samples that are copied together where columns do not lie side by side, or fetched ahead

template <class T>
struct Vector {
  typedef T type __attribute__((vector_size(BYTES)));
};
template <class T>
using V = typename Vector<T>::type;
template <class T>
constexpr long LANES = BYTES / sizeof(T);

template <class T>
struct Scratch {  // freed with the call; no std::vector, whose symbols tie a wheel to one C++ library
  V<T>* at;
  explicit Scratch(long n) : at((V<T>*)aligned_alloc(BYTES, n * BYTES)) { std::fill(at, at + n, V<T>{}); }
  ~Scratch() { free(at); }
};

// Orders that are summed as they are, even in number.
inline long direct(long count) { return (count / 2 + 3) / 4 * 4; }

// acc[k][r][j], k = 1 .. H: += sums over Q samples of w_r T_k; from H + 1 on of w_r T_m T_n, m + n = k.
template <class T, int R, int Q>
inline void add_samples(const T* v, long stride, const T* w, const Layout& s, T c, long W, V<T>* acc) {
  const long all = R ? R : s.rows, length = s.length, half = direct(s.count);
  for (long j = 0; j < W; j++) {
    V<T> twice[Q], before[Q], now[Q];
    UNROLL for (int i = 0; i < Q; i++) {
      V<T> a;
      memcpy(&a, v + i * stride + j * LANES<T>, BYTES);
      __builtin_prefetch(v + (i + ROWS) * stride + j * LANES<T>);
      a = a < 0 ? -a : a;
      twice[i] = (T(2) * a - T(2) * c) / (a + c);
      now[i] = twice[i] * T(0.5);
      before[i] = V<T>{} + T(1);
    }
    V<T> *to = acc + all * W + j, *product = acc + (half + 1) * all * W + j;
    auto add = [&](V<T>*& place, auto term) __attribute__((always_inline)) {
      UNROLL for (long r = 0; r < all; r++) {
        V<T> sum = place[r * W];
        UNROLL for (int i = 0; i < Q; i++) sum += w[r * length + i] * term(i);
        place[r * W] = sum;
      }
      place += all * W;
    };
    auto step = [&](V<T>* old, V<T>* own, bool products) __attribute__((always_inline)) {
      add(to, [&](int i) { return own[i]; });
      if (products) {
        add(product, [&](int i) { return old[i] * own[i]; });
        add(product, [&](int i) { return own[i] * own[i]; });
      }
      UNROLL for (int i = 0; i < Q; i++) old[i] = twice[i] * own[i] - old[i];
    };
    for (long k = 0; k < half / 2; k += 2) step(before, now, false), step(now, before, false);
    for (long k = 0; k < half / 2; k += 2) step(before, now, true), step(now, before, true);
  }
}

// One tile of a slab: its first n columns, in W vectors.
template <class T, int R>
void tile(const T* v, const T* w, double* found, const Layout& s, T c, long n, long W, V<T>* acc, T* copied) {
  const long half = direct(s.count), all = s.rows, wide = W * LANES<T>;
  std::fill(acc, acc + (2 * half + 1) * all * W, V<T>{});
  for (long t = 0; t < s.length; t += ROWS) {
    const long rows = std::min<long>(ROWS, s.length - t), four = rows / 4 * 4;
    const T* from = v + t * s.row_stride;
    long stride = s.row_stride;
    if (s.column_stride != 1 || n < wide) {
      for (long j = 0; j < n; j++)
        for (long i = 0; i < rows; i++) copied[i * wide + j] = from[i * s.row_stride + j * s.column_stride];
      from = copied, stride = wide;
    }
    for (long i = 0; i < four; i += 4) add_samples<T, R, 4>(from + i * stride, stride, w + t + i, s, c, W, acc);
    for (long i = four; i < rows; i++) add_samples<T, R, 1>(from + i * stride, stride, w + t + i, s, c, W, acc);
  }
  for (long r = 0; r < all; r++) {
    double weight = 0;
    for (long t = 0; t < s.length; t++) weight += w[r * s.length + t];
    const T* first = (const T*)(acc + (all + r) * W);
    for (long k = 0; k < s.count; k++) {
      const T* own = (const T*)(acc + (k * all + r) * W);
      double* to = found + (r * s.count + k) * s.columns;
      for (long j = 0; j < n; j++)
        to[j] = k == 0 ? weight : k <= half ? own[j] : 2 * (double)own[j] - (k % 2 ? first[j] : weight);
    }
  }
}

template <class T>
void sums(const T* v, const T* weights, double* found, const Layout& s, double centre) {
  const long most = (s.count * s.rows > 64 ? 128 : 256) / BYTES;
  const long W = std::min<long>(most, (s.columns + LANES<T> - 1) / LANES<T>);
  Scratch<T> acc((2 * direct(s.count) + 1) * s.rows * W), copied(ROWS * W);
  const auto of_rows = s.rows == 1 ? tile<T, 1> : s.rows == 3 ? tile<T, 3> : tile<T, 0>;
  for (long g = 0; g < s.slabs; g++)
    for (long left = 0; left < s.columns; left += W * LANES<T>)
      of_rows(v + g * s.slab_stride + left * s.column_stride, weights + g * s.rows * s.length,
              found + g * s.rows * s.count * s.columns + left, s, T(centre),
              std::min<long>(W * LANES<T>, s.columns - left), W, acc.at, (T*)copied.at);
}
}  // namespace

#define EXPORT(T, name)                                                                       \
  extern "C" void name(const T* v, const T* w, double* found, const Layout* s, double centre) { \
    sums(v, w, found, *s, centre);                                                            \
  }
EXPORT(float, sums_float32)
EXPORT(double, sums_float64)
