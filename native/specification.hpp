// Reads a Mechanism from the plain numbers of ccpin.native.specification, where every field is described.
#pragma once
#include "arrays.hpp"
#include "mechanism.hpp"
#include "simulate.hpp"

#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <stdexcept>
#include <string>

namespace ccpin {

class Reader {
 public:
  explicit Reader(nb::dict numbers) : s_(numbers) {}

  Mechanism mechanism() {
    m_.nq = integer("nq"), m_.nv = integer("nv"), m_.n_q = integer("n_q"), m_.n = integer("n");
    m_.direct = nb::cast<bool>(s_["direct"]), m_.turnable = nb::cast<bool>(s_["turnable"]);
    m_.tolerance = nb::cast<double>(s_["tolerance"]), m_.gravity = vec(s_["gravity"]);
    m_.reference = doubles(s_["reference"]);
    m_.joints.push_back({});
    for (nb::handle h : s_["joints"]) m_.joints.push_back(joint(tuple(h)));
    m_.m = 0;
    for (nb::handle h : s_["loops"]) m_.loops.push_back(loop(tuple(h)));
    for (nb::handle h : s_["couplings"]) m_.couplings.push_back(coupling(tuple(h)));
    m_.plain = true;
    for (nb::handle h : s_["coordinates"]) {
      m_.coordinates.push_back(coordinate(tuple(h)));
      const Coordinate& c = m_.coordinates.back();
      if (c.whole() && unit_window(c.kind).size) m_.plain = false;
    }
    motors_ = integers(s_["motors"]);
    m_.motors = m_.direct ? m_.n : int(motors_.size());
    m_.cluster_of.assign(m_.joints.size(), -1), m_.column_of.assign(m_.nv, -1), m_.carries.assign(m_.joints.size(), 0);
    for (nb::handle h : s_["clusters"]) add_cluster(tuple(h));
    return std::move(m_);
  }

  static Law law(nb::dict d, const Mechanism& m) {
    Law law;
    const std::string name = nb::cast<std::string>(d["kind"]);
    const auto found = std::find(std::begin(kLawNames), std::end(kLawNames), name);
    if (found == std::end(kLawNames)) throw std::invalid_argument("the core knows no law '" + name + "'");
    law.kind = LawKind(found - std::begin(kLawNames));
    const size_t n = m.n;
    law.path.start = flat(d["start"], m.n_q), law.path.breaks = flat(d["breaks"]);
    law.path.degree = nb::cast<int>(d["degree"]);
    const size_t pieces = law.path.breaks.size() > 1 ? law.path.breaks.size() - 1 : 0;
    law.path.coefficients = flat(d["coefficients"], pieces * (law.path.degree + 1) * n);
    law.K_p = flat(d["K_p"], n * n), law.K_v = flat(d["K_v"], n * n), law.constant = flat(d["constant"], n);
    return law;
  }
  static Run run(nb::dict d, const Mechanism& m) {
    const auto number = [&](const char* name) { return nb::cast<double>(d[name]); };
    Run r{flat(d["times"]), flat(d["start"], m.n_q + m.n), number("rtol"), number("atol"), number("max_step"),
          number("singular_rcond"), {}};
    r.settling = {flat(d["goal"]), number("band"), number("speed"), number("hold")};
    return r;
  }
  static Tableau tableau(nb::dict d) {
    Tableau t;
    t.A = flat(d["A"]), t.B = flat(d["B"]), t.C = flat(d["C"]);
    t.E = flat(d["E"]), t.E_low = flat(d["E_low"]), t.P = flat(d["P"]);
    t.stages = int(t.B.size()), t.extra = nb::cast<int>(d["extra"]), t.columns = nb::cast<int>(d["columns"]);
    t.error_order = nb::cast<int>(d["error_order"]);
    return t;
  }

 private:
  static constexpr size_t kAny = size_t(-1);
  static std::vector<double> flat(nb::handle h, size_t size = kAny) {
    std::vector<double> x = doubles(h);
    if (size != kAny && x.size() != size) throw std::invalid_argument("an array has a wrong length");
    return x;
  }
  nb::dict s_;
  Mechanism m_;
  std::vector<int> motors_;

  static nb::sequence sequence(nb::handle h) { return nb::cast<nb::sequence>(h); }
  static double number(nb::handle h) { return nb::cast<double>(h); }
  static nb::tuple tuple(nb::handle h) { return nb::cast<nb::tuple>(h); }
  static std::vector<int> integers(nb::handle h) { return nb::cast<std::vector<int>>(h); }
  static std::vector<double> doubles(nb::handle h) { return nb::cast<std::vector<double>>(h); }
  int integer(const char* name) const { return nb::cast<int>(s_[name]); }
  static In array(nb::handle h, Py_ssize_t size) {
    In x = nb::cast<In>(h);
    if (!x.given() || x.size != size) throw std::invalid_argument("an array of the specification has a wrong shape");
    return x;
  }
  static Vec3 vec(nb::handle h) { return Eigen::Map<const Vec3>(array(h, 3).data); }
  static Mat3 mat(nb::handle h) {
    const In x = array(h, 3);
    return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(x.data);
  }
  static Pose pose(nb::handle h) {
    const In x = array(h, 4);
    const Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>> M(x.data);
    return {M.topLeftCorner<3, 3>(), M.topRightCorner<3, 1>()};
  }
  static Kind kind(nb::handle h) {
    const std::string name = nb::cast<std::string>(h);
    for (int k = 0; k < 6; ++k)
      if (name == kKindNames[k]) return Kind(k);
    throw std::invalid_argument("the core knows no joint of kind '" + name + "'");
  }
  static Vector vector(nb::handle h) {
    const nb::tuple t = tuple(h);
    const std::string name = nb::cast<std::string>(t[0]);
    for (int k = 0; k < 4; ++k)
      if (name == kFrameNames[k]) return {Frame(k), vec(t[1])};
    throw std::invalid_argument("a closure has no frame '" + name + "'");
  }
  static Product product(nb::handle h) {
    const nb::tuple t = tuple(h);
    Product p{number(t[0]), vector(t[1]), vector(t[2])};
    if (p.x.frame == Frame::gap || p.y.frame == Frame::A) std::swap(p.x, p.y);
    if (p.x.frame != Frame::gap) p.x.local *= p.weight, p.weight = 1;
    return p;
  }
  static LoopRow row(nb::handle h) {
    LoopRow row{Form::direction, {}};
    for (nb::handle p : sequence(h)) row.products.push_back(product(p));
    const auto fits = [](const Product& p, Frame x, Frame y) { return p.x.frame == x && p.y.frame == y; };
    for (const Product& p : row.products)
      if (!fits(p, Frame::A, Frame::B)) row.form = Form::any;
    if (row.products.size() == 1 && fits(row.products[0], Frame::C, Frame::gap)) row.form = Form::point;
    return row;
  }

  Joint joint(nb::tuple t) const {
    Joint j{};
    j.kind = kind(t[0]), j.parent = nb::cast<int>(t[1]);
    const std::vector<int> window = integers(t[2]);
    j.q = window[0], j.v = window[1], j.nq = window[2], j.nv = window[3];
    j.placement = pose(t[3]), j.axis = vec(t[4]);
    j.mass = nb::cast<double>(t[5]), j.centre = vec(t[6]), j.inertia = mat(t[7]);
    const std::vector<double> armature = doubles(t[8]);
    j.armature.fill(0);
    std::copy(armature.begin(), armature.end(), j.armature.begin());
    return j;
  }

  Loop loop(nb::tuple t) {
    Loop l{};
    const std::vector<int> ends = integers(t[0]);
    l.a = ends[0], l.b = ends[1], l.ancestor = ends[2];
    l.frame_a = pose(t[1]), l.frame_b = pose(t[2]);
    for (nb::handle h : sequence(t[3])) l.rows.push_back(row(h));
    for (nb::handle h : sequence(t[4])) l.alignment.push_back({vec(tuple(h)[0]), vec(tuple(h)[1])});
    l.path_a = integers(t[5]), l.path_b = integers(t[6]);
    l.size = int(l.rows.size());
    l.row = m_.m, m_.m += l.size;
    return l;
  }

  Coupling coupling(nb::tuple t) {
    Coupling g{{}, nb::cast<double>(t[1]), m_.m++};
    for (nb::handle h : nb::cast<nb::sequence>(t[0])) {
      const nb::tuple x = tuple(h);
      g.terms.push_back({nb::cast<int>(x[0]), nb::cast<int>(x[1]), nb::cast<bool>(x[2]), doubles(x[3]),
                         nb::cast<double>(x[4])});
    }
    return g;
  }

  static Coordinate coordinate(nb::tuple t) {
    const std::vector<int> window = integers(t[3]);
    return {kind(t[0]), nb::cast<int>(t[1]), nb::cast<int>(t[2]), window[0], window[1], window[2], window[3],
            doubles(t[4])};
  }

  void add_cluster(nb::tuple t) {
    Cluster c;
    c.parent = nb::cast<int>(t[0]), c.joints = integers(t[1]), c.loops = integers(t[2]);
    c.couplings = integers(t[3]), c.coordinates = integers(t[4]);
    for (int j : c.joints) {
      m_.cluster_of[j] = int(m_.clusters.size());
      for (int k = 0; k < m_.joints[j].nv; ++k) {
        m_.column_of[m_.joints[j].v + k] = c.width();
        c.columns.push_back(m_.joints[j].v + k);
      }
    }
    for (int i : c.loops) {
      Loop& loop = m_.loops[i];
      c.loop_rows += loop.size, loop.base = c.parent;
      loop.columns_a = columns(loop.path_a), loop.columns_b = columns(loop.path_b);
    }
    if (c.parent) m_.carries[c.parent] = 1, m_.clusters[m_.cluster_of[c.parent]].carries = true;
    choose_columns(c);
    if (c.rows() < c.unknowns()) throw std::invalid_argument("a cluster has fewer rows than unknowns");
    find_pattern(c);
    m_.clusters.push_back(c);
  }

  std::vector<Column> columns(const std::vector<int>& path) const {
    std::vector<Column> found;
    for (int j : path)
      for (int k = m_.joints[j].v; k < m_.joints[j].v + m_.joints[j].nv; ++k) found.push_back({k, m_.column_of[k]});
    return found;
  }

  // Which unknowns occur in the rows of one loop, coupling or component alone; `dependent` in the order of elimination.
  void find_pattern(Cluster& c) const {
    std::vector<std::pair<int, std::vector<int>>> groups;  // rows, and the local columns they have
    for (int i : c.loops) {
      groups.push_back({m_.loops[i].size, {}});
      for (const auto& path : {m_.loops[i].columns_a, m_.loops[i].columns_b})
        for (const Column& k : path) groups.back().second.push_back(k.local);
    }
    for (int i : c.couplings) {
      groups.push_back({1, {}});
      for (const CouplingTerm& t : m_.couplings[i].terms) groups.back().second.push_back(m_.column_of[t.v]);
    }
    for (int i : c.components) {
      const Joint& joint = m_.joints[m_.coordinates[i].joint];
      groups.push_back({1, {}});
      for (int k = 0; k < joint.nv; ++k) groups.back().second.push_back(m_.column_of[joint.v + k]);
    }
    std::vector<int> owner(c.width(), -1), order;  // by local column: its group; −2: several
    for (int g = 0; g < int(groups.size()); ++g)
      for (int col : groups[g].second) owner[col] = owner[col] == -1 || owner[col] == g ? g : -2;
    Pattern& p = c.pattern;
    Block last;
    int row = 0;
    for (int g = 0; g < int(groups.size()); ++g) {
      Block b{{}, int(order.size()), 0};
      for (int k = 0; k < groups[g].first; ++k) b.rows.push_back(row++);
      for (int col : c.dependent)
        if (owner[col] == g && order.size() < b.first + b.rows.size()) order.push_back(col);
      b.end = int(order.size());
      last.rows.insert(last.rows.end(), b.rows.begin() + (b.end - b.first), b.rows.end());
      p.slots.insert(p.slots.end(), b.rows.begin(), b.rows.begin() + (b.end - b.first));
      if (b.end > b.first) p.blocks.push_back(b);
    }
    p.shared = last.first = int(order.size()), last.end = p.n = c.unknowns(), p.rows = c.rows();
    for (int col : c.dependent)
      if (std::find(order.begin(), order.end(), col) == order.end()) order.push_back(col);
    p.slots.insert(p.slots.end(), last.rows.begin(), last.rows.begin() + (last.end - last.first));
    p.blocks.push_back(last);
    c.dependent = order;
  }

  void choose_columns(Cluster& c) const {
    std::vector<char> chosen(c.columns.size(), 0);
    for (int i : c.coordinates) {
      const Coordinate& k = m_.coordinates[i];
      (k.whole() ? c.whole : c.components).push_back(i);
      for (int s = 0; k.whole() && s < k.nv; ++s) {
        const int col = m_.column_of[m_.joints[k.joint].v + s];
        chosen[col] = 1, c.direct.push_back(col), c.independent.push_back(k.v + s);
      }
    }
    for (int i : c.components) c.independent.push_back(m_.coordinates[i].v);
    for (int col = 0; col < c.width(); ++col)
      if (!chosen[col]) c.dependent.push_back(col);
    for (size_t r = 0; r < motors_.size() && !m_.direct; ++r)
      for (int col = 0; col < c.width(); ++col)
        if (c.columns[col] == motors_[r]) c.motors.push_back(int(r)), c.motor_columns.push_back(col);
  }
};

}  // namespace ccpin
