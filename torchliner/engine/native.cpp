// Sums of Chebyshev functions of |v|: what torch_sums of chebyshev_sums.py defines, for columns first .. last - 1.
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

namespace {
constexpr int ROWS = 32;  // samples that are copied together where columns do not lie side by side

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

template <class T>
struct Scratch {  // aligned to cache lines, freed with the call
  T* at;
  explicit Scratch(size_t n) : at((T*)aligned_alloc(64, (n * sizeof(T) + 63) / 64 * 64)) { std::fill(at, at + n, T(0)); }
  ~Scratch() { free(at); }
};

// Orders that are summed as they are, even in number.
inline long direct(long count) { return (count / 2 + 3) / 4 * 4; }

// acc[k][r][j], k = 1 .. 3/2 * 2H: += sums over Q samples of w_r T_k, and from H + 1 on of w_r T_m T_n, m + n = k.
template <class T, int R, int Q>
inline void add_samples(const T* v, long stride, const T* w, long length, long rows, T c, long half, long W, T* acc) {
  const long all = R ? R : rows;
  for (long j = 0; j < W; j += Vector<T>::lanes) {
    V<T> twice[Q], before[Q], now[Q];
    UNROLL for (int i = 0; i < Q; i++) {
      V<T> a = load(v + i * stride + j);
      a = a < 0 ? -a : a;
      twice[i] = (T(2) * a - T(2) * c) / (a + c);
      now[i] = twice[i] * T(0.5);
      before[i] = V<T>{} + T(1);
    }
    T *to = acc + all * W + j, *product = acc + (half + 1) * all * W + j;
    auto add = [&](T*& place, auto term) __attribute__((always_inline)) {
      UNROLL for (long r = 0; r < all; r++) {
        V<T> sum = load(place + r * W);
        UNROLL for (int i = 0; i < Q; i++) sum += w[r * length + i] * term(i);
        store(place + r * W, sum);
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

template <class T>
struct Slabs {
  const T* v;                               // (G, L, N) with these strides
  int64_t slab_stride, row_stride, column_stride;
  const T* weights;                         // (G, R, L)
  int64_t slabs, rows, length, count, columns;
  double centre;
  double* sums;                             // (G, R, K, N)
};

// One tile, n columns from `left` on, W wide.
template <class T, int R>
void tile(const Slabs<T>& s, long g, long left, long n, long W, T* acc, T* copied) {
  const long half = direct(s.count), all = s.rows, K = s.count, size = (2 * half + 1) * all * W;
  const T *w = s.weights + g * all * s.length, *v = s.v + g * s.slab_stride + left * s.column_stride;
  const bool in_place = s.column_stride == 1 && n == W;
  std::fill(acc, acc + size, T(0));
  for (long t = 0; t < s.length; t += ROWS) {
    const long rows = std::min<long>(ROWS, s.length - t), four = rows / 4 * 4;
    const T* from = v + t * s.row_stride;
    long stride = s.row_stride;
    if (!in_place) {
      for (long i = 0; i < rows; i++)
        for (long j = 0; j < n; j++) copied[i * W + j] = from[i * s.row_stride + j * s.column_stride];
      from = copied, stride = W;
    }
    for (long i = 0; i < four; i += 4)
      add_samples<T, R, 4>(from + i * stride, stride, w + t + i, s.length, all, T(s.centre), half, W, acc);
    for (long i = four; i < rows; i++)
      add_samples<T, R, 1>(from + i * stride, stride, w + t + i, s.length, all, T(s.centre), half, W, acc);
  }
  for (long r = 0; r < all; r++) {
    double weight = 0;
    for (long t = 0; t < s.length; t++) weight += w[r * s.length + t];
    for (long k = 0; k < K; k++) {
      const T *own = acc + (k * all + r) * W, *first = acc + (all + r) * W;
      double* to = s.sums + ((g * all + r) * K + k) * s.columns + left;
      for (long j = 0; j < n; j++)
        to[j] = k == 0 ? weight : k <= half ? own[j] : 2 * (double)own[j] - (k % 2 ? first[j] : weight);
    }
  }
}

template <class T>
void sums(const Slabs<T>& s, long first, long last) {
  const long lanes = Vector<T>::lanes, most = (s.count * s.rows > 64 ? 128 : 256) / sizeof(T);
  const long W = std::min<long>(std::max<long>(most, lanes), (last - first + lanes - 1) / lanes * lanes);
  Scratch<T> acc((2 * direct(s.count) + 1) * s.rows * W), copied(ROWS * W);
  for (long g = 0; g < s.slabs; g++)
    for (long left = first; left < last; left += W) {
      const long n = std::min<long>(W, last - left);
      (s.rows == 1 ? tile<T, 1> : s.rows == 3 ? tile<T, 3> : tile<T, 0>)(s, g, left, n, W, acc.at, copied.at);
    }
}
}  // namespace

extern "C" void sums_float32(const Slabs<float>* s, int64_t first, int64_t last) { sums(*s, first, last); }
extern "C" void sums_float64(const Slabs<double>* s, int64_t first, int64_t last) { sums(*s, first, last); }
