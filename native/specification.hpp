// Reads a Mechanism from the plain numbers of ccpin.native.specification, where every field is described, and checks
// that whatever points somewhere points to where there is something: nothing after that looks at an index twice.
#pragma once
#include "mechanism.hpp"
#include "reading.hpp"

namespace ccpin {

class Reader {
 public:
  explicit Reader(nb::dict numbers) : s_(numbers) {}

  Mechanism mechanism() {
    return reading::checked([&] { return read(); });
  }

 private:
  nb::dict s_;
  Mechanism m_;
  std::vector<int> motors_;
  std::vector<double> gears_, unstructured_;

  Mechanism read() {
    using namespace reading;
    m_.direct = nb::cast<bool>(s_["direct"]), m_.turnable = nb::cast<bool>(s_["turnable"]);
    m_.tolerance = number(s_["tolerance"]), m_.gravity = vec(s_["gravity"]);
    m_.nq = m_.nv = m_.m = m_.n_q = m_.n = 0;
    m_.joints.push_back({});
    for (nb::handle h : sequence(s_["joints"])) m_.joints.push_back(joint(tuple(h, 12)));
    require(integer(s_["nq"]) == m_.nq && integer(s_["nv"]) == m_.nv, "the joints are not as many as nq and nv say");
    m_.reference = numbers(s_["reference"], m_.nq);
    for (nb::handle h : sequence(s_["loops"])) m_.loops.push_back(loop(tuple(h, 7)));
    for (nb::handle h : sequence(s_["couplings"])) m_.couplings.push_back(coupling(tuple(h, 2)));
    m_.plain = true;
    for (nb::handle h : sequence(s_["coordinates"])) {
      m_.coordinates.push_back(coordinate(tuple(h, 5)));
      const Coordinate& c = m_.coordinates.back();
      if (c.whole() && unit_window(c.kind).size) m_.plain = false;
    }
    require(integer(s_["n_q"]) == m_.n_q && integer(s_["n"]) == m_.n, "the coordinates are not as many as n_q and n say");
    unstructured_ = numbers(s_["unstructured"], 2 * size_t(m_.m + m_.n));
    motors_ = integers(s_["motors"]), gears_ = numbers(s_["gears"], motors_.size());
    for (int k : motors_) require(k >= 0 && k < m_.nv, "there is no joint for a motor");
    m_.motors = m_.direct ? m_.n : int(motors_.size());
    m_.cluster_of.assign(m_.joints.size(), -1), m_.column_of.assign(m_.nv, -1), m_.carries.assign(m_.joints.size(), 0);
    for (nb::handle h : sequence(s_["clusters"])) add_cluster(tuple(h, 5));
    size_t joints = 1, loops = 0, couplings = 0, coordinates = 0;
    for (const Cluster& c : m_.clusters) {
      joints += c.joints.size(), loops += c.loops.size();
      couplings += c.couplings.size(), coordinates += c.coordinates.size();
    }
    require(joints == m_.joints.size() && loops == m_.loops.size() && couplings == m_.couplings.size() &&
                coordinates == m_.coordinates.size(),
            "something belongs to no cluster");
    return std::move(m_);
  }

  int joint_number(int j, bool or_world) const {
    reading::require(j >= !or_world && j < int(m_.joints.size()), "there is no such joint");
    return j;
  }
  static Kind kind(nb::handle h) { return Kind(reading::place_of(reading::text(h), kKindNames, "joint of kind")); }

  static Vector vector(nb::handle h) {
    const nb::tuple t = reading::tuple(h, 2);
    return {Frame(reading::place_of(reading::text(t[0]), kFrameNames, "frame of a closure")), reading::vec(t[1])};
  }
  static Product product(nb::handle h) {
    const nb::tuple t = reading::tuple(h, 3);
    Product p{reading::number(t[0]), vector(t[1]), vector(t[2])};
    if (p.x.frame == Frame::gap || p.y.frame == Frame::A) std::swap(p.x, p.y);
    if (p.x.frame != Frame::gap) p.x.local *= p.weight, p.weight = 1;
    return p;
  }
  static LoopRow row(nb::handle h) {
    LoopRow row{Form::direction, {}};
    for (nb::handle p : reading::sequence(h)) row.products.push_back(product(p));
    const auto fits = [](const Product& p, Frame x, Frame y) { return p.x.frame == x && p.y.frame == y; };
    for (const Product& p : row.products)
      if (!fits(p, Frame::A, Frame::B)) row.form = Form::any;
    if (row.products.size() == 1 && fits(row.products[0], Frame::C, Frame::gap)) row.form = Form::point;
    return row;
  }

  Joint joint(nb::tuple t) {
    using namespace reading;
    Joint j{};
    j.kind = kind(t[0]), j.parent = joint_number(integer(t[1]), true);
    const auto [nq, nv] = kSizes[int(j.kind)];
    j.q = m_.nq, j.v = m_.nv, j.nq = nq, j.nv = nv;
    require(integers(t[2]) == std::vector<int>{j.q, j.v, j.nq, j.nv}, "a joint's windows are not those after the last's");
    m_.nq += nq, m_.nv += nv;
    j.placement = pose(t[3]), j.axis = vec(t[4]);
    j.turned = j.placement.R != Mat3::Identity(), j.along = -1;
    for (int k = 0; k < 3; ++k)
      if (std::abs(j.axis[k]) == 1 && j.axis.squaredNorm() == 1) j.along = k;
    j.mass = number(t[5]), j.centre = vec(t[6]), j.inertia = mat(t[7]);
    const std::vector<double> armature = numbers(t[8], nv);
    j.armature.fill(0);
    std::copy(armature.begin(), armature.end(), j.armature.begin());
    const std::vector<double> damping = numbers(t[9], nv), spring = numbers(t[10], 2);
    j.damping.fill(0);
    std::copy(damping.begin(), damping.end(), j.damping.begin());
    j.stiffness = spring[0], j.rest = spring[1], j.stribeck_speed = number(t[11]);
    return j;
  }

  // The joints from an ancestor (left out) to an end.
  std::vector<int> path(nb::handle h, int ancestor, int end) const {
    const std::vector<int> path = reading::integers(h);
    int last = ancestor;
    for (int j : path) {
      reading::require(m_.joints[joint_number(j, false)].parent == last, "a closure's path is broken");
      last = j;
    }
    reading::require(last == end, "a closure's path does not lead to its end");
    return path;
  }

  Loop loop(nb::tuple t) {
    using namespace reading;
    Loop l{};
    const std::vector<int> ends = integers(t[0], 3);
    l.a = joint_number(ends[0], true), l.b = joint_number(ends[1], true), l.ancestor = joint_number(ends[2], true);
    l.frame_a = pose(t[1]), l.frame_b = pose(t[2]);
    for (nb::handle h : sequence(t[3])) {
      l.rows.push_back(row(h));
      for (const Product& p : l.rows.back().products)
        for (const Frame frame : {p.x.frame, p.y.frame}) l.turns |= frame == Frame::A || frame == Frame::B;
    }
    for (nb::handle h : sequence(t[4])) {
      const nb::tuple pair = tuple(h, 2);
      l.alignment.push_back({vec(pair[0]), vec(pair[1])}), l.turns = true;
    }
    l.path_a = path(t[5], l.ancestor, l.a), l.path_b = path(t[6], l.ancestor, l.b);
    require(!l.path_a.empty() || !l.path_b.empty(), "a closure joins two frames of one body");
    l.size = int(l.rows.size());
    l.row = m_.m, m_.m += l.size;
    return l;
  }

  Coupling coupling(nb::tuple t) {
    using namespace reading;
    Coupling g{{}, number(t[1]), m_.m++};
    for (nb::handle h : sequence(t[0])) {
      const nb::tuple x = tuple(h, 5);
      const CouplingTerm term{integer(x[0]), integer(x[1]), nb::cast<bool>(x[2]), numbers(x[3]), number(x[4])};
      require(term.q >= 0 && term.q + term.wrapped < m_.nq && term.v >= 0 && term.v < m_.nv, "a coupling has no joint");
      g.terms.push_back(term);
    }
    require(!g.terms.empty(), "a coupling has no terms");
    return g;
  }

  Coordinate coordinate(nb::tuple t) {
    using namespace reading;
    const int joint = joint_number(integer(t[1]), false), component = integer(t[2]);
    const Joint& j = m_.joints[joint];
    const Coordinate c{kind(t[0]), joint, component, m_.n_q, m_.n, component < 0 ? j.nq : 1, component < 0 ? j.nv : 1,
                       numbers(t[4], j.nq)};
    require(c.kind == j.kind && component >= -1 && (component < 0 || has_component(j.kind, component)),
            "a joint has no such component");
    require(integers(t[3]) == std::vector<int>{c.q, c.v, c.nq, c.nv}, "a coordinate's windows are not those after the last's");
    m_.n_q += c.nq, m_.n += c.nv;
    return c;
  }

  void add_cluster(nb::tuple t) {
    using namespace reading;
    Cluster c;
    c.parent = joint_number(integer(t[0]), true), c.joints = integers(t[1]), c.loops = integers(t[2]);
    c.couplings = integers(t[3]), c.coordinates = integers(t[4]);
    require(c.parent == 0 || m_.cluster_of[c.parent] >= 0, "a cluster comes before the one that carries it");
    const int here = int(m_.clusters.size());
    for (int j : c.joints) {
      const int parent = m_.joints[joint_number(j, false)].parent;
      require(m_.cluster_of[j] < 0, "a joint belongs to two clusters");
      require(parent == c.parent || (parent && m_.cluster_of[parent] == here), "a cluster's joints are not in order");
      m_.cluster_of[j] = here;
      for (int k = 0; k < m_.joints[j].nv; ++k) {
        m_.column_of[m_.joints[j].v + k] = c.width();
        c.columns.push_back(m_.joints[j].v + k);
      }
    }
    check_members(c, here);
    for (int i : c.loops) {
      Loop& loop = m_.loops[i];
      c.loop_rows += loop.size, loop.base = c.parent;
      loop.columns_a = columns(loop.path_a), loop.columns_b = columns(loop.path_b);
    }
    if (c.parent) m_.carries[c.parent] = 1, m_.clusters[m_.cluster_of[c.parent]].carries = true;
    choose_columns(c);
    require(c.rows() >= c.unknowns(), "a cluster has fewer rows than unknowns");
    find_pattern(c);
    place_columns(c);
    choose_right_sides(c);
    m_.clusters.push_back(c);
  }

  // Each thing of a cluster is there, once, and moves its joints alone.
  void check_members(const Cluster& c, int here) const {
    const auto each_once = [](std::vector<int> members, size_t count) {
      std::sort(members.begin(), members.end());
      const bool once = std::adjacent_find(members.begin(), members.end()) == members.end();
      reading::require(once && (members.empty() || (members.front() >= 0 && members.back() < int(count))),
                       "a cluster has what is not there, or twice");
    };
    each_once(c.loops, m_.loops.size()), each_once(c.couplings, m_.couplings.size());
    each_once(c.coordinates, m_.coordinates.size());
    const auto inside = [&](int j) { reading::require(m_.cluster_of[j] == here, "a cluster lacks a joint of its own"); };
    for (int i : c.loops) {
      for (int j : m_.loops[i].path_a) inside(j);
      for (int j : m_.loops[i].path_b) inside(j);
      if (m_.loops[i].ancestor != c.parent) inside(m_.loops[i].ancestor);
    }
    for (int i : c.couplings)
      for (const CouplingTerm& term : m_.couplings[i].terms) reading::require(in_columns(c, term.v), "a coupling leaves its cluster");
    std::vector<int> used;  // columns that are, or have components that are, coordinates
    for (int i : c.coordinates) {
      const Coordinate& k = m_.coordinates[i];
      inside(k.joint);
      used.push_back(8 * k.joint + (k.whole() ? 7 : k.component));
      for (int o : c.coordinates)
        reading::require(!k.whole() || o == i || m_.coordinates[o].joint != k.joint, "a joint is two coordinates");
    }
    std::sort(used.begin(), used.end());
    reading::require(std::adjacent_find(used.begin(), used.end()) == used.end(), "a component is two coordinates");
  }
  static bool in_columns(const Cluster& c, int component) {
    return std::find(c.columns.begin(), c.columns.end(), component) != c.columns.end();
  }

  std::vector<Column> columns(const std::vector<int>& path) const {
    std::vector<Column> found;
    for (int j : path)
      for (int k = m_.joints[j].v; k < m_.joints[j].v + m_.joints[j].nv; ++k) found.push_back({k, m_.column_of[k], 0});
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

  // J's columns: the dependent ones in the order of elimination, then the direct ones.
  void place_columns(Cluster& c) {
    c.place.assign(c.width(), 0);
    int place = 0;
    for (const auto& columns : {c.dependent, c.direct})
      for (int col : columns) c.place[col] = place++;
    for (int i : c.loops)
      for (auto* columns : {&m_.loops[i].columns_a, &m_.loops[i].columns_b})
        for (Column& k : *columns) k.place = c.place[k.local];
  }

  void choose_right_sides(Cluster& c) const {
    const auto add = [&](int row) {
      c.unstructured.insert(c.unstructured.end(), &unstructured_[2 * size_t(row)], &unstructured_[2 * size_t(row)] + 2);
    };
    for (int i : c.loops)
      for (int r = 0; r < m_.loops[i].size; ++r) add(m_.loops[i].row + r);
    for (int i : c.couplings) add(m_.couplings[i].row);
    for (int i : c.components) add(m_.m + m_.coordinates[i].v);
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
        if (c.columns[col] == motors_[r])
          c.motors.push_back(int(r)), c.motor_columns.push_back(col), c.gears.push_back(gears_[r]);
  }
};

}  // namespace ccpin
