#include "raysfm/places/pose_graph.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>
#include <vector>

#include "raysfm/optim/block_cholesky.h"

namespace raysfm {
namespace {

// A damping of no more than this is none. The stiffness of a long chain against being bent is 1 / n^4 of the
// diagonal: what would damp that least of all steps would stop the loop from being closed.
constexpr double kNoDamping = 1e-10;

// Residuals, in standard deviations, that nothing is to be gained from.
constexpr double kAgreement = 1e-7;

bool is_similarity(const Similarity3& s) {
  return std::isfinite(s.scale) && s.scale > 0 && s.translation.allFinite() &&
         s.rotation.coeffs().allFinite() && std::abs(s.rotation.squaredNorm() - 1) < 1e-6;
}

bool is_valid(const GraphEdge& edge, int nodes) {
  return edge.a >= 0 && edge.a < nodes && edge.b >= 0 && edge.b < nodes && edge.a != edge.b &&
         is_similarity(edge.b_from_a) && edge.sigma_translation > 0 && edge.sigma_rotation > 0 &&
         edge.sigma_log_scale > 0;
}

// Whether each node is to move: it has an edge, is free, and is not the one that holds its part of the graph.
std::vector<uint8_t> moving_nodes(std::span<const uint8_t> is_free, std::span<const GraphEdge> edges) {
  std::vector<int> root(is_free.size());
  std::iota(root.begin(), root.end(), 0);
  const auto root_of = [&](int node) {
    while (root[node] != node) node = root[node] = root[root[node]];
    return node;
  };
  std::vector<uint8_t> moves(is_free.size(), 0);
  for (const GraphEdge& edge : edges) {
    for (int node : {edge.a, edge.b}) moves[node] = is_free[node] != 0;
    const int a = root_of(edge.a), b = root_of(edge.b);
    root[std::max(a, b)] = std::min(a, b);
  }
  std::vector<uint8_t> is_held(is_free.size(), 0);
  for (size_t i = 0; i < is_free.size(); ++i) is_held[root_of(static_cast<int>(i))] |= !is_free[i];
  for (size_t i = 0; i < is_free.size(); ++i) moves[i] &= root[i] != static_cast<int>(i) || is_held[i];
  return moves;
}

// Of the nodes that move, N numbers each: with 6 the scales are held.
template <int N>
class Graph {
 public:
  Graph(std::span<const Similarity3> node_from_world, std::span<const uint8_t> moves,
        std::span<const GraphEdge> edges)
      : edges_(edges), unknown_(moves.size(), -1), cross_(edges.size()) {
    for (size_t i = 0; i < moves.size(); ++i) {
      nodes_.push_back(graph_node(node_from_world[i]));
      if (!moves[i]) continue;
      unknown_[i] = static_cast<int>(node_of_.size());
      node_of_.push_back(static_cast<int>(i));
    }
    moved_ = nodes_;
    own_.resize(node_of_.size());
    gradient_.resize(node_of_.size());
    step_.resize(N * node_of_.size());
    by_position_.resize(step_.size());
    work_.resize(step_.size());
    find_pattern();
  }

  int unknowns() const { return static_cast<int>(node_of_.size()); }
  int node_of(int unknown) const { return node_of_[unknown]; }
  Similarity3 solution(int unknown) const { return similarity_of(nodes_[node_of_[unknown]]); }

  double linearize();
  LmStep solve(double damping);
  LmTrial evaluate(bool linearize);
  void accept();

 private:
  using Block = Eigen::Matrix<double, N, N>;
  using Vector = Eigen::Matrix<double, N, 1>;

  void find_pattern();
  void add(const EdgeJacobian& by, const EdgeResidual& r, int unknown);
  void write(double damping);
  double decrease(double damping) const;

  std::span<const GraphEdge> edges_;
  std::vector<int> unknown_;  // by node; -1: held
  std::vector<int> node_of_;  // by unknown
  std::vector<GraphNode> nodes_, moved_;
  double cost_ = 0, moved_cost_ = 0;
  // The normal equations: own blocks and gradients of the unknowns, and blocks (a, b) by edge.
  std::vector<Block> own_, cross_;
  std::vector<Vector> gradient_;
  std::vector<double> step_, by_position_, work_;
  BlockCholesky cholesky_{N};
  WorkTeam team_;
};

template <int N>
void Graph<N>::find_pattern() {
  std::vector<std::pair<int, int>> pairs;
  for (const GraphEdge& edge : edges_) {
    const int a = unknown_[edge.a], b = unknown_[edge.b];
    if (a < 0 || b < 0) continue;
    pairs.push_back({a, b});
    pairs.push_back({b, a});
  }
  std::sort(pairs.begin(), pairs.end());
  pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
  std::vector<int> row_begin(unknowns() + 1, 0), columns;
  for (const auto& [row, column] : pairs) {
    ++row_begin[row + 1];
    columns.push_back(column);
  }
  std::partial_sum(row_begin.begin(), row_begin.end(), row_begin.begin());
  cholesky_.analyze(unknowns(), row_begin, columns);
}

template <int N>
void Graph<N>::add(const EdgeJacobian& by, const EdgeResidual& r, int unknown) {
  if (unknown < 0) return;
  const auto j = by.template topLeftCorner<N, N>();
  own_[unknown].noalias() += j.transpose() * j;
  gradient_[unknown].noalias() += j.transpose() * r.template head<N>();
}

template <int N>
double Graph<N>::linearize() {
  std::fill(own_.begin(), own_.end(), Block::Zero());
  std::fill(gradient_.begin(), gradient_.end(), Vector::Zero());
  cost_ = 0;
  EdgeJacobian by_a, by_b;
  for (size_t i = 0; i < edges_.size(); ++i) {
    const GraphEdge& edge = edges_[i];
    const EdgeResidual r = edge_residual(nodes_[edge.a], nodes_[edge.b], edge, &by_a, &by_b);
    cost_ += 0.5 * r.template head<N>().squaredNorm();
    add(by_a, r, unknown_[edge.a]);
    add(by_b, r, unknown_[edge.b]);
    cross_[i].noalias() =
        by_a.template topLeftCorner<N, N>().transpose() * by_b.template topLeftCorner<N, N>();
  }
  return cost_;
}

template <int N>
void Graph<N>::write(double damping) {
  using Target = Eigen::Map<Block, 0, Eigen::OuterStride<>>;
  const auto target = [&](int row, int column) {
    return Target(cholesky_.values() + cholesky_.offset(row, column),
                  Eigen::OuterStride<>(cholesky_.stride(column)));
  };
  cholesky_.set_zero();
  for (int i = 0; i < unknowns(); ++i) {
    const int position = cholesky_.position(i);
    auto block = target(position, position);
    block = own_[i];
    block.diagonal() += damping * own_[i].diagonal();
    Eigen::Map<Vector>{&by_position_[N * position]} = -gradient_[i];
  }
  for (size_t i = 0; i < edges_.size(); ++i) {
    const int a = unknown_[edges_[i].a], b = unknown_[edges_[i].b];
    if (a < 0 || b < 0) continue;
    const int row = cholesky_.position(a), column = cholesky_.position(b);
    if (row > column) {
      target(row, column) += cross_[i];
    } else {
      target(column, row) += cross_[i].transpose();
    }
  }
}

template <int N>
LmStep Graph<N>::solve(double damping) {
  if (damping <= kNoDamping) damping = 0;
  write(damping);
  if (!cholesky_.factorize(team_)) return {};
  cholesky_.solve(by_position_, work_);
  for (int i = 0; i < unknowns(); ++i) {
    std::copy_n(&by_position_[N * cholesky_.position(i)], N, &step_[N * i]);
  }
  // Relations that hold this well all agree, but for rounding.
  const double agreement = kAgreement * kAgreement * static_cast<double>(edges_.size());
  const double promised = cost_ > agreement ? decrease(damping) : 0;
  return {std::isfinite(promised), promised};
}

template <int N>
double Graph<N>::decrease(double damping) const {
  double sum = 0;
  for (int i = 0; i < unknowns(); ++i) {
    const Eigen::Map<const Vector> d(&step_[N * i]);
    sum += 0.5 * d.dot(damping * own_[i].diagonal().cwiseProduct(d) - gradient_[i]);
  }
  return sum;
}

template <int N>
LmTrial Graph<N>::evaluate(bool) {
  for (int i = 0; i < unknowns(); ++i) {
    GraphTangent delta = GraphTangent::Zero();
    delta.head<N>() = Eigen::Map<const Vector>(&step_[N * i]);
    moved_[node_of_[i]] = retract(nodes_[node_of_[i]], delta);
  }
  moved_cost_ = 0;
  for (const GraphEdge& edge : edges_) {
    moved_cost_ += 0.5 * edge_residual(moved_[edge.a], moved_[edge.b], edge).template head<N>().squaredNorm();
  }
  return {cost_, moved_cost_, false};
}

template <int N>
void Graph<N>::accept() {
  std::swap(nodes_, moved_);
  cost_ = moved_cost_;
}

template <int N>
LmSummary adjust(std::span<Similarity3> node_from_world, std::span<const uint8_t> moves,
                 std::span<const GraphEdge> edges, const GraphOptions& options) {
  Graph<N> graph(node_from_world, moves, edges);
  const LmSummary summary =
      levenberg_marquardt(graph, {.max_iterations = options.max_iterations,
                                  .min_relative_decrease = options.min_relative_decrease,
                                  .initial_damping = kNoDamping});
  for (int i = 0; i < graph.unknowns(); ++i) node_from_world[graph.node_of(i)] = graph.solution(i);
  return summary;
}

}  // namespace

LmSummary adjust_graph(std::span<Similarity3> node_from_world, std::span<const uint8_t> is_free,
                       std::span<const GraphEdge> edges, const GraphOptions& options) {
  LmSummary summary;
  const int nodes = static_cast<int>(node_from_world.size());
  if (is_free.size() != node_from_world.size() ||
      !std::all_of(node_from_world.begin(), node_from_world.end(), is_similarity) ||
      !std::all_of(edges.begin(), edges.end(), [&](const GraphEdge& e) { return is_valid(e, nodes); })) {
    summary.termination = Termination::kInvalidProblem;
    return summary;
  }
  const std::vector<uint8_t> moves = moving_nodes(is_free, edges);
  if (std::find(moves.begin(), moves.end(), 1) == moves.end()) return summary;
  return options.scale_is_known ? adjust<6>(node_from_world, moves, edges, options)
                                : adjust<7>(node_from_world, moves, edges, options);
}

}  // namespace raysfm
