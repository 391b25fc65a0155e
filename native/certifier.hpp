// What `ccpin.native.certifier` calls: certificates of many boxes, each alone, so that results depend on no other row.
#pragma once
#include "reading.hpp"
#include "tubes.hpp"

#include <algorithm>
#include <initializer_list>

namespace ccpin::certificates {

class Certifier {
 public:
  explicit Certifier(nb::dict numbers) : c_(reading::checked([&] { return read(numbers); })) {}

  // φ and φ_θ at each θ.
  nb::object values(In theta) const {
    const Py_ssize_t B = rows(theta, c_.n_free);
    double *phi, *jacobian;
    const nb::object a = new_array({B, c_.m}, phi), b = new_array({B, c_.m, c_.n_free}, jacobian);
    Values at;
    for (Py_ssize_t k = 0; k < B; ++k) {
      c_.evaluate(theta.data + k * c_.n_free, at);
      std::copy(at.phi.begin(), at.phi.end(), phi + k * c_.m);
      std::copy(at.jacobian.begin(), at.jacobian.end(), jacobian + k * c_.m * c_.n_free);
    }
    return nb::make_tuple(a, b);
  }

  // φ, φ_θ, φ_θθ at each θ, by the chains, and |∂x/∂θ| by chain and joint, padded at the root side.
  nb::object derivatives(In theta) const {
    const Py_ssize_t B = rows(theta, c_.n_free), m = c_.m, n_free = c_.n_free;
    Py_ssize_t longest = 0;
    for (const Chain& c : c_.chains) longest = std::max(longest, Py_ssize_t(c.joints.size()));
    const Py_ssize_t arms = Py_ssize_t(c_.chains.size()) * longest;
    double *phi, *jacobian, *hessian, *arm;
    const nb::object a = new_array({B, m}, phi), b = new_array({B, m, n_free}, jacobian),
                     c = new_array({B, m, n_free, n_free}, hessian),
                     d = new_array({B, Py_ssize_t(c_.chains.size()), longest}, arm);
    {
      nb::gil_scoped_release release;
      Values at;
      std::fill_n(arm, B * arms, 0.);
      for (Py_ssize_t k = 0; k < B; ++k) {
        c_.evaluate_chains(theta.data + k * n_free, at);
        std::copy(at.phi.begin(), at.phi.end(), phi + k * m);
        std::copy(at.jacobian.begin(), at.jacobian.end(), jacobian + k * m * n_free);
        c_.second(at, hessian + k * m * n_free * n_free);
        double* end = arm + k * arms;
        for (const Chain& chain : c_.chains) {
          end += longest;
          const size_t count = chain.joints.size();
          for (size_t j = 0; j < count; ++j) end[int(j) - int(count)] = at.b[chain.first + j].norm();
        }
      }
    }
    return nb::make_tuple(a, b, c, d);
  }

  // Y, Z̄(R)R and Z(R)w of boxes (the fields of `Boxes`) as they are.
  nb::object bounds(nb::tuple boxes) const {
    if (boxes.size() != 8) wrong();
    const In half = nb::cast<In>(boxes[1]);
    if (half.dimensions != 2) wrong();
    const Py_ssize_t B = half.rows, m = c_.m;
    const Fields fields(c_, boxes, B, half.size);
    double *y, *image, *shrunk;
    const nb::object a = new_array({B, m}, y), b = new_array({B, m}, image), c = new_array({B, m}, shrunk);
    Krawczyk krawczyk(c_);
    Box box;
    for (Py_ssize_t k = 0; k < B; ++k) {
      fields.read(k, box);
      krawczyk.bounds(box, y + k * m, image + k * m, shrunk + k * m);
    }
    return nb::make_tuple(a, b, c);
  }

  // θ, whether Newton settled, slopes one step before.
  nb::object newton(In theta, int iterations, double accuracy) const {
    const Py_ssize_t B = rows(theta, c_.n_free);
    double *out, *slopes;
    bool* settled;
    const nb::object a = new_array({B, c_.n_free}, out), b = new_array({B}, settled);
    const nb::object c = new_array({B, c_.m, c_.n}, slopes);
    std::copy_n(theta.data, B * c_.n_free, out);
    {
      nb::gil_scoped_release release;
      Tubes tubes(c_);
      for (Py_ssize_t k = 0; k < B; ++k)
        settled[k] = tubes.newton(out + k * c_.n_free, iterations, accuracy, slopes + k * c_.m * c_.n);
    }
    return nb::make_tuple(a, b, c);
  }

  // The fields of `Boxes`, and which are proved; `across` is (n, p) or (B, n, p).
  nb::object certify_boxes(In centre, In half, In across) const {
    const Py_ssize_t B = rows(centre, c_.n_free), p = half.size;
    const bool each = across.dimensions == 3;
    if (half.dimensions != 2 || half.rows != B || across.dimensions < 2 || across.size != p) wrong();
    if (across.rows != (each ? B : c_.n) || (each && across.middle != c_.n)) wrong();
    const Py_ssize_t stride = each ? c_.n * p : 0;
    Columns out(c_, B, int(p));
    {
      nb::gil_scoped_release release;
      Krawczyk krawczyk(c_);
      Box box;
      for (Py_ssize_t k = 0; k < B; ++k) {
        const double *at = centre.data + k * c_.n_free, *widths = half.data + k * p;
        out.write(k, at, widths, box, krawczyk.certify(at, widths, int(p), across.data + k * stride, box));
      }
    }
    return out.arrays();
  }

  // Boxes with p = 0 that enclose a solution at fixed q near each θ.
  nb::object certify_points(In theta) const {
    const Py_ssize_t B = rows(theta, c_.n_free);
    Columns out(c_, B, 0);
    {
      nb::gil_scoped_release release;
      Krawczyk krawczyk(c_);
      Box box;
      for (Py_ssize_t k = 0; k < B; ++k) {
        const bool proved = krawczyk.certify_point(theta.data + k * c_.n_free, box);
        out.write(k, theta.data + k * c_.n_free, nullptr, box, proved);
      }
    }
    return out.arrays();
  }

  // Which boxes (the fields of `Boxes`) carry the same solution as others at points given by their parameters.
  nb::object glued(nb::tuple first, In delta, nb::tuple second, In delta_second) const {
    const Py_ssize_t p = delta.size, p_second = delta_second.size, B = rows(delta, p);
    if (rows(delta_second, p_second) != B) wrong();
    const Fields a(c_, first, B, p), b(c_, second, B, p_second);
    bool* same;
    const nb::object out = new_array({B}, same);
    {
      nb::gil_scoped_release release;
      Tubes tubes(c_);
      Box one, other;
      for (Py_ssize_t k = 0; k < B; ++k) {
        a.read(k, one), b.read(k, other);
        same[k] = tubes.glued(one, delta.data + k * p, other, delta_second.data + k * p_second);
      }
    }
    return out;
  }

 private:
  const Closures c_;

  [[noreturn]] static void wrong() { throw std::invalid_argument("an array has a wrong shape"); }
  static Py_ssize_t rows(const In& x, Py_ssize_t width) {
    if (!x.is_matrix(width)) wrong();
    return x.rows;
  }

  // The fields of `Boxes` for `count` rows, to be written, and a mask.
  class Columns {
   public:
    Columns(const Closures& c, Py_ssize_t count, int p) : c_(c), p_(p) {
      const int m = c.m, n_free = c.n_free;
      add({count, n_free}), add({count, p}), add({count, n_free, p}), add({count, m, m}), add({count, m, m});
      add({count, m}), add({count, m}), add({count});
      mask_ = new_array({count}, proved_);
    }
    void write(Py_ssize_t k, const double* centre, const double* half, const Box& box, bool proved) {
      const size_t m = c_.m, n_free = c_.n_free;
      std::copy_n(centre, n_free, data_[0] + k * n_free), std::copy_n(half, p_, data_[1] + k * p_);
      const Doubles* fields[] = {&box.directions, &box.modes, &box.preconditioner, &box.radius, &box.weight};
      const size_t sizes[] = {n_free * p_, m * m, m * m, m, m};
      for (int f = 0; f < 5; ++f) {
        double* to = data_[f + 2] + k * sizes[f];
        proved || f < 3 ? std::copy_n(fields[f]->data(), sizes[f], to) : std::fill_n(to, sizes[f], 0.);
      }
      data_[7][k] = proved ? box.kappa : 0, proved_[k] = proved;
    }
    nb::object arrays() const { return nb::make_tuple(nb::tuple(list_), mask_); }

   private:
    const Closures& c_;
    const int p_;
    nb::list list_;
    std::vector<double*> data_;
    nb::object mask_;
    bool* proved_;

    void add(std::initializer_list<Py_ssize_t> shape) {
      double* data;
      list_.append(new_array(shape, data)), data_.push_back(data);
    }
  };

  // The fields of `Boxes`, to be read.
  class Fields {
   public:
    Fields(const Closures& c, nb::tuple boxes, Py_ssize_t count, Py_ssize_t p) {
      const Py_ssize_t m = c.m, widths[] = {c.n_free, p, p, m, m, m, m, count};
      const Py_ssize_t sizes[] = {c.n_free, p, c.n_free * p, m * m, m * m, m, m, 1};
      if (boxes.size() != 8) wrong();
      for (int f = 0; f < 8; ++f) {
        arrays_.push_back(nb::cast<In>(boxes[f])), sizes_.push_back(sizes[f]);
        const In& x = arrays_[f];
        if (x.size != widths[f] || (f < 7 && x.rows != count) || x.rows * x.middle * x.size != count * sizes[f]) wrong();
      }
      m_ = int(m);
    }
    void read(Py_ssize_t k, Box& box) const {
      Doubles* to[] = {&box.centre, &box.half, &box.directions, &box.modes, &box.preconditioner, &box.radius, &box.weight};
      for (int f = 0; f < 7; ++f) to[f]->assign(at(f, k), at(f, k) + sizes_[f]);
      box.kappa = *at(7, k), box.plain = true;
      for (int i = 0; i < m_; ++i)
        for (int e = 0; e < m_; ++e) box.plain = box.plain && box.modes[i * m_ + e] == (i == e);
    }

   private:
    std::vector<In> arrays_;
    std::vector<Py_ssize_t> sizes_;
    int m_;

    const double* at(int field, Py_ssize_t k) const { return arrays_[field].data + k * sizes_[field]; }
  };

  // Reading what `ccpin.native.certifier.numbers_of` describes.
  static Doubles doubles(nb::handle h, size_t size) {
    const In x = nb::cast<In>(h);
    const size_t count = x.dimensions == 2 ? size_t(x.rows) * x.size : size_t(x.size);
    if (!x.given() || x.dimensions > 2 || count != size || !In::finite(x.data, Py_ssize_t(size))) wrong();
    return Doubles(x.data, x.data + size);
  }
  static V3 vector(nb::handle h) { return V3(doubles(h, 3).data()); }

  static Closures read(nb::dict d) {
    Closures c;
    c.independent = nb::cast<std::vector<int>>(d["independent"]);
    c.dependent = nb::cast<std::vector<int>>(d["dependent"]);
    c.n = int(c.independent.size()), c.m = int(c.dependent.size()), c.n_free = c.n + c.m;
    std::vector<int> all(c.independent);
    all.insert(all.end(), c.dependent.begin(), c.dependent.end());
    std::sort(all.begin(), all.end());
    for (int k = 0; k < c.n_free; ++k)
      if (all[k] != k) wrong();
    for (int x : reading::integers(d["periodic"], c.n_free)) c.periodic.push_back(char(x != 0));
    c.scale = reading::number(d["scale"]), c.gamma = reading::number(d["gamma"]);
    reading::require(c.m > 0 && c.scale > 0 && c.gamma >= 0, "no closures, or a scale or margin that is none");
    c.offset = doubles(d["offset"], c.m), c.moduli = doubles(d["moduli"], c.m);
    const Doubles G = doubles(d["couplings"], size_t(c.m) * c.n_free);
    for (int r = 0; r < c.m; ++r)
      for (int k = 0; k < c.n_free; ++k)
        if (G[r * c.n_free + k] != 0) c.couplings.push_back({r, k, G[r * c.n_free + k]});
    for (nb::handle h : nb::cast<nb::list>(d["chains"])) c.chains.push_back(chain(nb::cast<nb::tuple>(h), c));
    c.planar = nb::cast<bool>(d["planar"]);
    if (c.planar) c.phasors = phasors(nb::cast<nb::tuple>(d["phasors"]), c);
    return c;
  }

  static Phasors phasors(nb::tuple t, const Closures& c) {
    if (t.size() != 6) wrong();
    Phasors p;
    const size_t K = p.count = int(nb::cast<In>(t[1]).size), m = c.m, n_free = c.n_free;
    p.signs = doubles(t[0], K * n_free), p.lengths = doubles(t[1], K), p.cosine_weights = doubles(t[2], m * K);
    p.sine_weights = doubles(t[3], m * K), p.linear = doubles(t[4], m * n_free), p.offset = doubles(t[5], m);
    return p;
  }

  // (joints, rotations, translations, axes, prismatic, tip, direction, weights) of a `Chain`; counts its joints.
  static Chain chain(nb::tuple t, Closures& c) {
    if (t.size() != 8) wrong();
    Chain chain;
    const auto columns = nb::cast<std::vector<int>>(t[0]), slides = nb::cast<std::vector<int>>(t[4]);
    const size_t k = columns.size(), m = c.m;
    if (slides.size() != k) wrong();
    const Doubles rotations = doubles(t[1], 9 * k), translations = doubles(t[2], 3 * k), axes = doubles(t[3], 3 * k);
    for (size_t j = 0; j < k; ++j) {
      const M3 R = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(&rotations[9 * j]);
      if (columns[j] < 0 || columns[j] >= c.n_free) wrong();
      chain.joints.push_back(joint(columns[j], slides[j] != 0, R, V3(&translations[3 * j]), V3(&axes[3 * j])));
    }
    chain.tip = vector(t[5]), chain.tip_length = chain.tip.norm();
    chain.direction = nb::cast<bool>(t[6]), chain.largest_weight = 1;
    const Doubles weights = doubles(t[7], 3 * m);
    for (int r = 0; r < c.m; ++r) {
      const V3 weight(&weights[3 * r]);
      if (!weight.isZero(0)) chain.rows.push_back({r, weight});
      chain.largest_weight = std::max(chain.largest_weight, weight.norm());
    }
    chain.first = c.joints, c.joints += int(k);
    return chain;
  }

  static ChainJoint joint(int column, bool slides, const M3& R, const V3& translation, const V3& axis) {
    constexpr double loose = 64 * 0x1p-53;  // of entries: what 8u a column vector can make of them, and rounding here
    if (!(R.transpose() * R - M3::Identity()).isZero(loose) || std::abs(axis.squaredNorm() - 1) > loose)
      throw std::invalid_argument("a placement or an axis is not orthonormal to rounding");
    M3 cross;
    cross << 0, -axis.z(), axis.y(), axis.z(), 0, -axis.x(), -axis.y(), axis.x(), 0;
    const V3 turned = R * axis;
    const M3 along = turned * axis.transpose();
    if (slides) return {column, true, R, M3::Zero(), M3::Zero(), translation, turned, translation.norm()};
    return {column, false, along, R - along, R * cross, translation, turned, translation.norm()};
  }
};

}  // namespace ccpin::certificates
