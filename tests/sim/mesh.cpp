// SPDX-License-Identifier: MIT
#include "sim/scene/mesh.hpp"

#include "../fixtures/error.hpp"
#include "../fixtures/folder.hpp"
#include "acquire/measurement/depth_map.hpp"
#include "scenes.hpp"
#include "sim/sensors/optics.hpp"

using namespace echofuse::sim;

namespace {

// Box of 1 x 2 x 0.5, centred at the origin.
constexpr const char* box_obj = R"(# a box
o box
v -0.5 -1 -0.25
v  0.5 -1 -0.25
v  0.5  1 -0.25
v -0.5  1 -0.25
v -0.5 -1  0.25
v  0.5 -1  0.25
v  0.5  1  0.25
v -0.5  1  0.25
vn 0 0 -1
f 1//1 4//1 3//1 2//1
f 5 6 7 8
f 1/1/1 2/2/1 6 5
f -6 -5 -1 -2
f 1 5 8 4
f 2 3 7 6
)";

std::string refusal(const std::string& text) {
  std::string said = test::refusal_by([&] { read_mesh(text, "a.mesh"); });
  CHECK(said.find('\n') == said.npos);
  return said;
}

Triangle moved(const Mesh& mesh, std::size_t i, Vec3 by) {
  const auto& [a, b, c] = mesh.triangles[i];
  return {mesh.points[a] + by, mesh.points[b] + by, mesh.points[c] + by, 0.6};
}

}  // namespace

TEST_CASE("a box mesh renders exactly like plates at the positions of its faces") {
  const Mesh mesh = read_mesh(box_obj, "box.obj");
  CHECK(mesh.points.size() == 8);
  CHECK(mesh.triangles.size() == 12);
  const Vec3 place{0.7, -0.3, 3.5};
  Scene triangles, plates;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i)
    triangles.triangles.push_back(moved(mesh, i, place));
  const Vec3 x{1, 0, 0}, y{0, 1, 0}, z{0, 0, 1};
  const auto face = [&](Vec3 at, Vec3 u, Vec3 v, double width, double height) {
    plates.plates.push_back({place + at, u, v, {{-width / 2, 0, width / 2, 0, height}}, 0.6});
  };
  for (const double side : {-1.0, 1.0}) {
    face(0.25 * side * z, x, y, 1, 2);
    face(0.5 * side * x, z, y, 0.5, 2);
    face(1.0 * side * y, x, z, 1, 0.5);
  }
  const Conditions c;
  const Axis columns = record::depth_x_axis(200, 0.55), rows = record::depth_y_axis(200, 0.55);
  CHECK(render_depth_mm(triangles, columns, rows) == render_depth_mm(plates, columns, rows));
  const auto a = spd_rate(spd_returns(triangles, c), c), b = spd_rate(spd_returns(plates, c), c);
  CHECK(total(a) > 1000);
  for (std::size_t i = 0; i < a.size(); ++i)
    CHECK(std::abs(a[i] - b[i]) <= 1e-9 * std::max(a[i], b[i]) + 1e-12 * total(a));
}

TEST_CASE("rays do not pass between adjacent triangles of a mesh") {
  // The triangles form a fan around a hub. Some rays hit exactly the hub or an edge shared by two
  // triangles.
  Scene scene;
  const Vec3 hub{0.25, 0.125, 2};
  std::vector<Vec3> rim;
  for (int k = 0; k < 24; ++k)
    rim.push_back(hub +
                  Vec3{0.5 * std::cos(k * 0.2618), 0.5 * std::sin(k * 0.2618), 0.1 * (k % 3)});
  for (std::size_t k = 0; k + 1 < rim.size(); ++k)
    scene.triangles.push_back({hub, rim[k], rim[k + 1], 0.5});
  for (std::size_t k = 1; k + 1 < rim.size(); ++k)
    for (int step = 0; step < 100; ++step) {
      const Vec3 p = hub + step / 100.0 * (rim[k] - hub);
      const Axis x{"x", "tangent", "1", 1, p.x / p.z, 1e-3},
          y{"y", "tangent", "1", 1, p.y / p.z, 1e-3};
      const Hit hit = cast(scene, 0, x, y)[0];
      REQUIRE(hit.z_m == Approx(p.z).epsilon(1e-6));
    }
}

TEST_CASE("a mesh is placed on the floor, rotated and scaled") {
  const test::Folder folder;
  Conditions c;
  c.object = folder / "box.obj";
  std::ofstream(c.object) << box_obj;
  c.object_scale = 0.5;
  SceneSpec spec{SceneKind::object};
  spec.x_m = -0.4;
  spec.z_m = 3.25;
  spec.yaw_deg = 90;
  for (const char* up : {"y", "z"}) {
    c.object_up = up;
    const Scene scene = make_scene(c, spec, 1, 0);
    REQUIRE(scene.triangles.size() == 12);
    CHECK(scene.label == "object:box");
    Vec3 low{9, 9, 9}, high{-9, -9, -9};
    for (const auto& t : scene.triangles)
      for (const Vec3 p : {t.a, t.b, t.c}) {
        low = {std::min(low.x, p.x), std::min(low.y, p.y), std::min(low.z, p.z)};
        high = {std::max(high.x, p.x), std::max(high.y, p.y), std::max(high.z, p.z)};
      }
    const bool y_up = c.object_up == "y";
    CHECK(low.y == Approx(-c.camera_height_m));
    CHECK(high.y - low.y == Approx(y_up ? 1 : 0.25));
    CHECK(high.x - low.x == Approx(y_up ? 0.25 : 1));
    CHECK(high.z - low.z == Approx(0.5));
    CHECK((low.x + high.x) / 2 == Approx(-0.4));
    CHECK((low.z + high.z) / 2 == Approx(3.25));
  }
}

namespace {

// A letter F of rectangles. The upper end of its stem is closer to the viewer. The x axis points to
// the right, the y axis up, and the z axis towards the viewer.
std::string letter_obj(Vec3 (*in_file)(Vec3)) {
  // first and last x, first and last y, z
  const std::vector<std::array<double, 5>> bars{
      {0, .3, 0, 1.1, 0}, {0, .3, 1.1, 1.5, .4}, {.3, 1, 1.2, 1.5, 0}, {.3, .8, .6, .8, 0}};
  std::ostringstream out;
  for (const auto& [x0, x1, y0, y1, z] : bars) {
    for (const Vec3 corner : {Vec3{x0, y0, z}, {x1, y0, z}, {x1, y1, z}, {x0, y1, z}}) {
      const Vec3 p = in_file(corner);
      out << "v " << p.x << ' ' << p.y << ' ' << p.z << '\n';
    }
    out << "f -4 -3 -2 -1\n";
  }
  return out.str();
}

}  // namespace

TEST_CASE("meshes from right-handed files are not mirrored, whatever the up axis") {
  const test::Folder folder;
  struct File {
    const char* up;
    Vec3 (*in_file)(Vec3);
  };
  SceneSpec spec{SceneKind::object};
  spec.x_m = 0, spec.z_m = 3.2, spec.yaw_deg = 0;
  const auto y_up = [](Vec3 p) { return p; };
  const auto z_up = [](Vec3 p) { return Vec3{p.x, -p.z, p.y}; };
  const auto y_down = [](Vec3 p) { return Vec3{p.x, -p.y, -p.z}; };
  for (const auto& [up, in_file] : {File{"y", y_up}, File{"z", z_up}, File{"-y", y_down}}) {
    CAPTURE(up);
    Conditions c;
    c.object = folder / up + ".obj";
    c.object_up = up, c.camera_height_m = 0.75;
    std::ofstream(c.object) << letter_obj(in_file);
    const Scene scene = make_scene(c, spec, 1, 0);
    const auto depth_m = [&](double x_m, double y_m) {
      const Axis x{"x", "tangent", "1", 1, x_m / 3.2, 1e-3},
          y{"y", "tangent", "1", 1, y_m / 3.2, 1e-3};
      return double{cast(scene, 0, x, y)[0].z_m};
    };
    // The outline of the letter is centred at x = 0.5. In depth, the letter is centred 0.2 m behind
    // the upper end of the stem.
    CHECK(depth_m(-0.35, 0.5) == Approx(3).margin(1e-3));
    CHECK(depth_m(-0.35, -0.1) == Approx(3.4).margin(1e-3));
    CHECK(depth_m(0.3, 0.55) > 0);
    CHECK(depth_m(0.3, -0.6) == 0);
  }
}

TEST_CASE("a byte order mark and continued lines are read in meshes") {
  const std::string corners = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";
  const Mesh mesh = read_mesh("\xef\xbb\xbf" + corners + "f 1 2 \\\r\n 3 4\n", "a.mesh");
  CHECK(mesh.points.size() == 4);
  CHECK(mesh.triangles.size() == 2);
  CHECK(read_mesh("# C:\\meshes\\\n" + corners + "f 1 2 3 4\n", "a.mesh").points.size() == 4);
  CHECK_THAT(refusal(corners + "f 1 \\\n 2 \\\n 3\nf 1 2 9\n"), Catch::Contains("a.mesh:8: "));
}

TEST_CASE("concave faces of meshes are refused") {
  const std::string corners = "v 0 0 0\nv 2 0 0\nv 2 2 0\nv 1 .5 0\nv 0 2 0\n";
  for (const char* face : {"f 1 2 3 4 5\n", "f 4 5 1 2 3\n", "f 5 4 3 2 1\n", "f 1 3 2 5\n"})
    CHECK_THAT(refusal(corners + face),
               Catch::Contains("a.mesh:6: found \"f\"; expected a convex"));
  CHECK(read_mesh(corners + "f 1 2 3 5\nf 1 2 3\nf 1 1 2 3 5\n", "a.mesh").triangles.size() == 5);
}

TEST_CASE("the size of an object is stated, and an implausible size is refused") {
  const test::Folder folder;
  Conditions c;
  c.object = folder / "box.obj";
  std::ofstream(c.object) << box_obj;
  CHECK_THAT(object_text(c), Catch::Contains(".obj: 1 x 2 x 0.5 m, 12 triangles"));
  for (const double scale : {100.0, 3.1, 0.01}) {
    c.object_scale = scale;
    CHECK_THROWS_WITH(validate(c),
                      Catch::Contains("expected a longest side from 0.052 m (a pixel)"));
  }
  c.object_scale = 1;
  c.object = folder / "many.obj";
  std::ofstream many(c.object);
  many << "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
  for (int k = 0; k <= 50'000; ++k) many << "f 1 2 3\n";
  many.close();
  CHECK_THROWS_WITH(validate(c), Catch::Contains("50001 triangles; expected at most 50000"));
}

TEST_CASE("damaged mesh files are refused with the line number of the error") {
  const std::string corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
  for (const auto& [text, why] :
       {std::pair<std::string, const char*>{"v 0 0 zero\n",
                                            "a.mesh:1: found \"zero\"; expected a coordinate"},
        {"v 0 0 0\nv 1 0\n", "a.mesh:2: "},
        {corners + "f 1 2 4\n", "a.mesh:4: found \"4\""},
        {corners + "f 1 2 0\n", "index from 1 to 3"},
        {corners + "f 1 2 -4\n", "a.mesh:4: found \"-4\""},
        {"v 0 0 0\nf 1 1\n", "a.mesh:2: "},
        {"v 0 0 1e9\n", "a coordinate from -1e6 to 1e6"},
        {"", "no triangles"},
        {"ply\nformat ascii 1.0\nend_header\n", "expected a Wavefront OBJ file"},
        {"v \x1b[2J\n", "found \"\\x1b[2J\""}})
    CHECK_THAT(refusal(text), Catch::Contains(why));
  Rng rng = make_rng(4, 4);
  for (int k = 0; k < 3000; ++k) {
    std::string spoilt = box_obj;
    spoilt[rng() % spoilt.size()] = static_cast<char>(rng());
    refusal(spoilt);
  }
}
