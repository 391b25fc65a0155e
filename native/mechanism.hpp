// What a mechanism is: joints, closures, couplings, independent coordinates, and the clusters they tie joints into.
//
// A cluster is a set of joints that closures or couplings tie together, with everything between them: towards the rest
// of the mechanism it is one joint with n coordinates and many bodies (Chignoli, Adrian, Kim and Wensing, "A recursive
// rigid-body dynamics algorithm for systems with kinematic loops", 2023; Jain, Robot and Multibody Dynamics, 2011,
// ch. 15: constraint embedding). All of a cluster's vectors are written in the frame of the body that carries it.
#pragma once
#include "joints.hpp"
#include "linear.hpp"

#include <vector>

namespace ccpin {

// A vector fixed in a frame of a closure, or the gap p_B − p_A between its ends.
enum class Frame { A, B, C, gap };
constexpr const char* kFrameNames[] = {"A", "B", "C", "gap"};
struct Vector { Frame frame; Vec3 local; };

// w (x·y); where x is fixed its length holds the weight, and w is 1.
struct Product { double weight; Vector x, y; };

// A row Σ w (x·y) of φ. Two forms are evaluated sooner: the point row e·gap with e fixed in C, and Σ a·b of vectors of A
// with vectors of B.
enum class Form { point, direction, any };
struct LoopRow { Form form; std::vector<Product> products; };

struct Alignment { Vec3 a, b; };            // a of A and b of B, whose product is positive where closed the right way round

struct Column { int component, local, place; };  // a component of q̇′, its local column in the cluster, and its place in J

// One closure: its rows of φ as data (ccpin.kinematics.rows), its ends and the paths to them.
struct Loop {
  int a, b, ancestor;                       // joints that carry the ends, and their nearest common ancestor C
  Pose frame_a, frame_b;                    // closure frames in those joints' frames
  std::vector<LoopRow> rows;
  std::vector<Alignment> alignment;
  std::vector<int> path_a, path_b;          // joints from C (left out) to the ends
  std::vector<Column> columns_a, columns_b;  // of the joints on these paths
  int row, size;                            // window of φ
  int base = 0;                             // the joint that carries the loop's cluster
  bool turns = false;                       // whether its rows have vectors fixed in A or B
};

struct CouplingTerm { int q, v; bool wrapped; std::vector<double> coefficients; double reference; };
struct Coupling { std::vector<CouplingTerm> terms; double modulus; int row; };

// One independent coordinate: a whole joint, or one component of a joint with several freedoms.
struct Coordinate {
  Kind kind;
  int joint, component;                     // −1: whole; 0…2: translations, 3…5: rotations
  int q, v, nq, nv;                         // windows of q and q̇
  std::vector<double> reference;            // the joint's configuration at the centre of the chart
  bool whole() const { return component < 0; }
  bool turns() const { return kind == Kind::planar && component == 5; }  // an angle known up to whole turns
};

struct Cluster {
  int parent;                               // the joint whose body carries it, 0: the world
  std::vector<int> joints;                  // parents first
  std::vector<int> loops, couplings, coordinates;
  std::vector<int> columns;                 // which component of q̇′ each local column is
  std::vector<int> dependent, direct;       // local columns solved for; and those that are components of q̇ themselves
  std::vector<int> place;                   // by local column: its place in J, which has the dependent ones first
  Pattern pattern;                          // of J's dependent columns
  std::vector<int> whole, components;       // its coordinates of the two kinds
  std::vector<int> independent;             // components of q̇, in the order of ρ's columns: direct ones first
  std::vector<int> motors, motor_columns;   // (where motors are not the independent joints) which of u, at which column
  std::vector<double> gears;                // of these
  std::vector<double> unstructured;         // B (rows × 2): right sides without structure
  int loop_rows = 0;                        // rows: of loops, then of couplings, then of components
  bool carries = false;                     // other clusters hang on its bodies
  int n() const { return int(independent.size()); }
  int width() const { return int(columns.size()); }
  int unknowns() const { return int(dependent.size()); }
  int phi_rows() const { return loop_rows + int(couplings.size()); }
  int rows() const { return phi_rows() + int(components.size()); }
};

struct Mechanism {
  std::vector<Joint> joints;                // 0: the world
  std::vector<Loop> loops;
  std::vector<Coupling> couplings;
  std::vector<Coordinate> coordinates;
  std::vector<Cluster> clusters;            // parents first
  std::vector<int> cluster_of, column_of;   // by joint; by component of q̇′: its local column
  std::vector<char> carries;                // by joint: whether a cluster hangs on it
  std::vector<double> reference;            // q′ that defines the default branch
  Vec3 gravity;
  int nq, nv, m, n, n_q, motors;            // sizes of q′, q̇′, φ, q̇, q and u
  bool direct;                              // motors are the independent joints: ρᵀSᵀu = u
  bool turnable;                            // a closure may close with its axes turned end for end
  bool plain;                               // q holds no circle and no quaternion
  double tolerance;                         // of Newton's method on ψ̄
};

}  // namespace ccpin
