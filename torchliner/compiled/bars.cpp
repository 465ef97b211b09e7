// The sums of signals/bars.py, which says what they mean, for columns first..last-1 of complex
// (S, N). A lane of a vector has a column, so that none knows its neighbours or the threads.
#include <algorithm>
#include <cstdint>
#include <vector>

namespace {
#if defined(__AVX512F__)
constexpr int WIDE = 8;
#elif defined(__AVX__)
constexpr int WIDE = 4;
#else
constexpr int WIDE = 2;
#endif
typedef double Lanes __attribute__((vector_size(8 * WIDE)));
typedef int64_t Places __attribute__((vector_size(8 * WIDE)));
typedef std::vector<Lanes> Room;

// Real parts, then imaginary parts, of columns left..left+n-1; lanes to spare repeat the last one.
void gather(const double* series, int64_t rows, int64_t columns, int64_t left, int n, Lanes* out) {
  for (int64_t s = 0; s < rows; s++) {
    const double* row = series + 2 * (s * columns + left);
    for (int i = 0; i < WIDE; i++) {
      int j = 2 * std::min(i, n - 1);
      out[s][i] = row[j];
      out[rows + s][i] = row[j + 1];
    }
  }
}

int lanes(int64_t left, int64_t last) { return (int)std::min<int64_t>(WIDE, last - left); }
}  // namespace

extern "C" {
void neighbours(const double* series, int64_t rows, int64_t columns, double* out, int64_t first,
                int64_t last) {
  Room at(2 * rows);
  for (int64_t left = first; left < last; left += WIDE) {
    int n = lanes(left, last);
    gather(series, rows, columns, left, n, at.data());
    Lanes power = {}, cross = {};
    for (int part = 0; part < 2; part++) {
      const Lanes* own = at.data() + part * rows;
      Lanes mean = {}, before = {};
      for (int64_t s = 0; s < rows; s++) mean += own[s];
      mean /= (double)rows;
      for (int64_t s = 0; s < rows; s++) {
        Lanes away = own[s] - mean;
        power += away * away;
        cross += away * before;
        before = away;
      }
    }
    for (int i = 0; i < n; i++) out[left + i] = power[i], out[columns + left + i] = cross[i];
  }
}

void forms(const double* series, int64_t rows, int64_t columns, const double* covariances,
           const int64_t* which, double* out, int64_t first, int64_t last) {
  Room at(2 * rows);
  for (int64_t left = first; left < last; left += WIDE) {
    int n = lanes(left, last);
    const int64_t* mine = which + left;
    gather(series, rows, columns, left, n, at.data());
    for (int k = 0; k < n; k++) {
      if (std::find(mine, mine + k, mine[k]) != mine + k) continue;  // its covariance is done
      Lanes xx = {}, yy = {}, xy = {};
      for (int64_t s = 0; s < rows; s++) {
        const double* row = covariances + (mine[k] * rows + s) * rows;
        Lanes x = {}, y = {};
        for (int64_t t = 0; t < rows; t++) x += row[t] * at[t], y += row[t] * at[rows + t];
        xx += at[s] * x, yy += at[rows + s] * y, xy += at[s] * y;
      }
      for (int i = k; i < n; i++)
        if (mine[i] == mine[k]) {
          double* to = out + left + i;
          to[0] = xx[i], to[columns] = yy[i], to[2 * columns] = xy[i];
        }
    }
  }
}

void extremes(const double* ahead, const double* share, int64_t two, int64_t columns,
              const double* circle, int64_t angles, double* out, int64_t first, int64_t last) {
  Room at(2 * angles);
  Lanes n_axes[4], u_axes[4];  // real parts of both axes, then imaginary parts
  for (int64_t left = first; left < last; left += WIDE) {
    int n = lanes(left, last);
    gather(ahead, two, columns, left, n, n_axes);
    gather(share, two, columns, left, n, u_axes);
    for (int64_t a = 0; a < angles; a++) {
      double c = circle[a], s = circle[angles + a];
      Lanes x = n_axes[0] * c + n_axes[1] * s, y = n_axes[2] * c + n_axes[3] * s;
      Lanes p = 1 - (u_axes[0] * c + u_axes[1] * s), q = u_axes[2] * c + u_axes[3] * s;
      Lanes scale = 1 / (p * p + q * q);
      at[a] = (x * p - y * q) * scale;
      at[angles + a] = (x * q + y * p) * scale;
    }
    for (int which = 0; which < 4; which++) {
      const Lanes* values = at.data() + which / 2 * angles;
      const double sign = which % 2 ? 1 : -1;
      Lanes top = sign * values[0];
      Places place = {};
      for (int64_t a = 1; a < angles; a++) {
        Lanes value = sign * values[a];
        place = value > top ? a - (Places){} : place;
        top = value > top ? value : top;
      }
      for (int i = 0; i < n; i++) {  // with a parabola through the best and its neighbours
        double before = sign * values[(place[i] + angles - 1) % angles][i];
        double after = sign * values[(place[i] + 1) % angles][i];
        double curve = 2 * top[i] - before - after, slope = after - before;
        double more = curve > 0 ? slope * slope / (8 * curve) : 0;
        out[which * columns + left + i] = sign * (top[i] + more);
      }
    }
  }
}
}
