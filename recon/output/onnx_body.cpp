// SPDX-License-Identifier: MIT
#include "recon/output/onnx_body.hpp"

#include <algorithm>

#include "recon/output/onnx_layers.hpp"

namespace echofuse::recon::onnx {
namespace {

constexpr float steep = 1e5f;  // of what is 0 below 0 and 1 above 0

// Where the pixels of a map's row or column lie among the cells of the frame.
struct Grid {
  Axis axis;          // of the pixels
  double from_place;  // cells lie at axis * depth - from_place * tangent * depth
  double first_m;     // cell 0
  std::size_t cells;
};

class BodyGraph {
 public:
  BodyGraph(Graph& graph, const BodyLayers& body, const std::string& inputs)
      : graph_(graph), body_(body), inputs_(inputs), side_(body.frame.map.size) {
    std::vector<float> gain;
    for (const float deviation : body.deviation) gain.push_back(1 / deviation);
    standardised_ = add_scaling(graph, inputs, body.centre, gain);
  }

  std::string map() {
    find_place();
    if (!body_.shapes.empty()) amounts_ = outputs(body_.shapes, "shape");
    const BodyFrame::Grid& frame = body_.frame;
    const Grid across{frame.map.x(), 1, frame.left_m, frame.columns};
    const Grid down{frame.map.y(), 0, frame.top_m, frame.rows};
    const std::string columns = weights(across, false), rows = weights(down, true);
    const std::string share = drawn(rows, body_.masks, columns);
    const std::string relief = drawn(rows, body_.reliefs, columns);
    const std::string above = plus(share, -body_.threshold);
    const std::string shown = multiplied(step(times(above, steep)), inside(across, down));
    const std::string divisor = plus(graph_.node("Relu", {above}), body_.threshold);
    // Reshaped as the other summand: OpenCV 4.6 takes them for different in shape otherwise.
    const std::string place = flat(repeated(depth_, side_ * side_));
    const std::string offset = graph_.node("Div", {relief, divisor});
    const std::string depth = graph_.node("Add", {place, offset});
    const std::string background =
        graph_.constant("background", body_.background, {body_.background.size()});
    const std::string before = graph_.node("Sub", {depth, background});
    return graph_.node("Add", {multiplied(shown, before), background});
  }

 private:
  std::string name(const std::string& what) { return what + std::to_string(constants_++); }
  std::string with_number(const std::string& operation, const std::string& value, float number) {
    const std::string constant = graph_.constant(name("number"), std::vector<float>{number}, {1});
    return graph_.node(operation, {value, constant});
  }
  std::string plus(const std::string& value, float number) {
    return with_number("Add", value, number);
  }
  std::string times(const std::string& value, float number) {
    return with_number("Mul", value, number);
  }
  std::string multiplied(const std::string& a, const std::string& b) {
    return graph_.node("Mul", {a, b});
  }
  std::string joined(const std::vector<std::string>& values) {
    return graph_.node("Concat", values, {attribute("axis", 1)});
  }
  std::string layer(const std::string& value, const AffineLayer& layer) {
    return add_layer(graph_, value, layer, name("layer"));
  }
  std::string at_least(const std::string& value, float least) {
    return plus(graph_.node("Relu", {plus(value, -least)}), least);
  }
  // As it is between 0 and 1.
  std::string step(const std::string& value) {
    return graph_.node("Sub",
                       {graph_.node("Relu", {value}), graph_.node("Relu", {plus(value, -1)})});
  }
  std::string repeated(const std::string& value, std::size_t columns) {
    AffineLayer ones{Matrix(1, columns), std::vector<float>(columns)};
    std::fill(ones.weights.values.begin(), ones.weights.values.end(), 1.f);
    return layer(value, ones);
  }
  // The outputs of networks, one behind the other.
  std::string outputs(const std::vector<Layers>& networks, const std::string& what) {
    std::vector<std::string> out;
    for (const Layers& network : networks)
      out.push_back(add_layers(graph_, standardised_, network, name(what) + "/"));
    return out.size() == 1 ? out.front() : joined(out);
  }
  // Of the mean of so many networks.
  std::string layer_of_mean(const std::string& outputs, const AffineLayer& layer,
                            std::size_t networks) {
    AffineLayer all{Matrix(0, layer.weights.cols), layer.biases};
    std::vector<float> row;
    for (std::size_t i = 0; i < networks * layer.weights.rows; ++i) {
      const auto weights = layer.weights.row(i % layer.weights.rows);
      row.assign(weights.begin(), weights.end());
      for (float& weight : row) weight /= static_cast<float>(networks);
      all.weights.add_row(row);
    }
    return this->layer(outputs, all);
  }
  static AffineLayer column(std::size_t at, std::size_t columns) {
    AffineLayer out{Matrix(columns, 1), {0}};
    out.weights.values[at] = 1;
    return out;
  }

  void find_place() {
    const std::size_t inputs = body_.centre.size(), networks = body_.positions.size();
    const std::size_t columns = body_.positions.front().back().biases.size();
    const std::string found = outputs(body_.positions, "position");
    const std::string side_m = layer_of_mean(found, column(0, columns), networks);
    const std::string behind_m = layer_of_mean(found, column(1, columns), networks);
    range_ = layer(inputs_, column(inputs - 1, inputs));
    depth_ = at_least(graph_.node("Add", {range_, behind_m}), body_.nearest_m);
    const std::string tangent = graph_.node("Div", {side_m, at_least(range_, body_.nearest_m)});
    place_ = joined({depth_, multiplied(tangent, depth_)});
  }

  // Of value i: factor * (where pixel i / stride or i % stride lies - the other one), in cells.
  template <class PixelAndCell>
  std::string distances(const Grid& grid, std::size_t count, double factor,
                        const PixelAndCell& of) {
    const double per_m = factor / body_.frame.pitch_m;
    AffineLayer out{Matrix(2, count), std::vector<float>(count)};
    for (std::size_t i = 0; i < count; ++i) {
      const auto [pixel, cell] = of(i);
      out.weights.row(0)[i] = static_cast<float>(per_m * grid.axis.at(static_cast<double>(pixel)));
      out.weights.row(1)[i] = static_cast<float>(-per_m * grid.from_place);
      out.biases[i] =
          static_cast<float>(-per_m * grid.first_m - factor * static_cast<double>(cell));
    }
    return layer(place_, out);
  }

  // Of the linear interpolation: [n, pixels, cells] or [n, cells, pixels].
  std::string weights(const Grid& grid, bool pixels_first) {
    const std::size_t inner = pixels_first ? grid.cells : side_;
    const auto distance = distances(grid, side_ * grid.cells, 1, [&](std::size_t i) {
      return pixels_first ? std::pair(i / inner, i % inner) : std::pair(i % inner, i / inner);
    });
    const std::string weight =
        graph_.node("Relu", {plus(times(graph_.node("Abs", {distance}), -1), 1)});
    const auto cells = static_cast<std::int64_t>(grid.cells),
               pixels = static_cast<std::int64_t>(side_);
    return pixels_first ? add_reshape(graph_, weight, name("shape"), {-1, pixels, cells})
                        : add_reshape(graph_, weight, name("shape"), {-1, cells, pixels});
  }

  // 1 for pixels between the first and the last cell; [n, pixels].
  std::string between(const Grid& grid) {
    const auto steps = [&](double factor, std::size_t cell) {
      return step(
          distances(grid, side_, factor, [&](std::size_t i) { return std::pair(i, cell); }));
    };
    return multiplied(steps(double{steep}, 0), steps(-double{steep}, grid.cells - 1));
  }

  // 1 for pixels that the frame covers, 0 for all if nobody is there; [n, pixels of the map].
  std::string inside(const Grid& across, const Grid& down) {
    const std::string there = step(times(graph_.node("Abs", {range_}), steep));
    const std::string rows = multiplied(between(down), repeated(there, side_));
    const std::string product = graph_.node(
        "MatMul",
        {add_reshape(graph_, rows, name("shape"), {-1, static_cast<std::int64_t>(side_), 1}),
         add_reshape(graph_, between(across), name("shape"),
                     {-1, 1, static_cast<std::int64_t>(side_)})});
    return flat(product);
  }

  // Cells of these amounts, drawn into the map.
  std::string drawn(const std::string& rows, const AffineLayer& kind, const std::string& columns) {
    const auto height = static_cast<std::int64_t>(body_.frame.rows);
    const auto width = static_cast<std::int64_t>(body_.frame.columns);
    const std::string cells = body_.shapes.empty()
                                  ? layer(range_, {Matrix(1, kind.biases.size()), kind.biases})
                                  : layer_of_mean(amounts_, kind, body_.shapes.size());
    const std::string patch = add_reshape(graph_, cells, name("shape"), {-1, height, width});
    return flat(graph_.node("MatMul", {graph_.node("MatMul", {rows, patch}), columns}));
  }
  std::string flat(const std::string& map) {
    return add_reshape(graph_, map, name("shape"), {-1, static_cast<std::int64_t>(side_ * side_)});
  }

  Graph& graph_;
  const BodyLayers& body_;
  std::string inputs_;
  std::size_t side_;  // of the map
  std::string standardised_, amounts_;
  std::string range_, depth_;  // metres, [n, 1]
  std::string place_;          // [n, 2]: depth, depth * tangent
  std::size_t constants_ = 0;
};

}  // namespace

std::string add_body(Graph& graph, const BodyLayers& body, const std::string& inputs) {
  return BodyGraph(graph, body, inputs).map();
}

}  // namespace echofuse::recon::onnx
