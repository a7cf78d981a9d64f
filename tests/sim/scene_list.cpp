// SPDX-License-Identifier: MIT
#include "sim/scene/scene_list.hpp"

#include "../fixtures/error.hpp"
#include "../fixtures/folder.hpp"
#include "../fixtures/record.hpp"
#include "acquire/record/run_reader.hpp"
#include "sim/dataset/generator.hpp"

using namespace echofuse::sim;
using namespace echofuse::test;

namespace {

constexpr const char* list = R"([[scene]]
kind = "person"
x_m = 0.5
z_m = 3.5
yaw_deg = 20

[[scene]]
kind = "letter"
count = 2
z_m = 3

[[scene]]
kind = "empty"
)";

}  // namespace

TEST_CASE("the scenes in a scene list are read in order, each with its count and parameters") {
  const auto all = read_scene_list(list, "list.toml");
  SceneSpec person{SceneKind::person}, letter{SceneKind::letter};
  person.x_m = 0.5, person.z_m = 3.5, person.yaw_deg = 20, letter.z_m = 3;
  CHECK(all == std::vector{person, letter, letter, SceneSpec(SceneKind::empty)});
}

TEST_CASE("all errors of a scene list are reported with line and column") {
  const std::string many =
      "[[scene]]\nkind = \"persn\"\n[[scene]]\ncount = 0\nkind = \"empty\"\nx_m = 1\n"
      "[[scene]]\nkind = \"person\"\nx = 2\n";
  for (const auto& [text, why] : {std::pair<std::string, const char*>{
                                      many, "list.toml:2:8: kind: expected one of person, letter"},
                                  {many, "list.toml:4:9: count"},
                                  {many, "valid only for a person, letter or object"},
                                  {many, "list.toml:9:5: x: unknown key"},
                                  {"[[scene]]\ncount = 2\n", "list.toml:1:1: kind is missing"},
                                  {"", "no [[scene]]"},
                                  {"scene = 1\n", "[[scene]] tables only"},
                                  {"kind = \n", "not TOML"}})
    check_error(ExitCode::config, why, [&] { read_scene_list(text, "list.toml"); });
}

TEST_CASE("a given scene position does not change the other parameters of the scene") {
  const Conditions c;
  for (const auto kind : {SceneKind::person, SceneKind::letter}) {
    SceneSpec spec{kind};
    const Scene free = make_scene(c, spec, 3, 8);
    spec.x_m = 0.3;
    spec.z_m = 3.2;
    spec.yaw_deg = 0;
    const Scene placed = make_scene(c, spec, 3, 8);
    REQUIRE(placed.capsules.size() == free.capsules.size());
    for (std::size_t i = 0; i < free.capsules.size(); ++i) {
      CHECK(placed.capsules[i].radius_m == free.capsules[i].radius_m);
      CHECK(length(placed.capsules[i].a - placed.capsules[i].b) ==
            Approx(length(free.capsules[i].a - free.capsules[i].b)));
    }
    CHECK(placed.label == free.label);
    // Capsule 6 is the pelvis.
    const Vec3 middle = 0.5 * (placed.capsules[6].a + placed.capsules[6].b);
    const double height = placed.capsules[11].radius_m / 0.055;
    // The tolerance is 2 % of the body height, because the body may be tilted.
    CHECK(std::abs(middle.x - 0.3) < 0.02 * height);
  }
}

TEST_CASE("record k of a scene list does not depend on the generation order or the list length") {
  const Folder folder;
  const std::string path = folder / "list.toml", run = folder / "a.sqlite";
  std::ofstream(path) << list;
  Plan plan;
  plan.scenes = path;
  CHECK(write_dataset(plan, {run, "", 2, true}) == 4);
  std::ofstream(path) << std::string(list).substr(0, std::string(list).rfind("[["));
  const Generator shorter(plan);
  REQUIRE(shorter.records() == 3);
  for (std::int64_t k = 2; k >= 0; --k) {
    const auto r = shorter.make(k), stored = record::RunReader(run).read(k);
    CHECK(stored.label == r.label);
    CHECK(difference(stored, r) == "");
  }
  plan.scenes.clear();
  plan.objects = 1;
  CHECK_THROWS_WITH(scenes_of(plan), Catch::Contains("object = \"FILE.obj\""));
}
