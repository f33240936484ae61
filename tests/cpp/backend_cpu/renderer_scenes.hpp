// Scenes that several tests of the CPU renderer draw, and what watches over a drawing.
#pragma once

#include <cfenv>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <glm/geometric.hpp>

#include "backend_cpu/cpu_renderer.hpp"
#include "base/instruction_set.hpp"
#include "support/cpu_drawing.hpp"

namespace sheetsplat::backend_cpu {

using test::askew;
using test::ball;
using test::cloud;
using test::CpuDrawing;
using test::Distance;
using test::distance;
using test::DrawOptions;
using test::pixels_of;
using test::scene_of;
using test::Shot;

constexpr double pi = 3.14159265358979323846;

/// Puts the best instruction set back.
struct SetChoice {
    ~SetChoice() { choose_instruction_set(""); }
};

/// What arithmetic on this thread has raised since this was made.
class Raised {
  public:
    Raised() { std::feclearexcept(FE_ALL_EXCEPT); }
    [[nodiscard]] std::string names() const {
        std::string names;
        names += std::fetestexcept(FE_INVALID) != 0 ? " invalid" : "";
        names += std::fetestexcept(FE_DIVBYZERO) != 0 ? " division by zero" : "";
        names += std::fetestexcept(FE_OVERFLOW) != 0 ? " overflow" : "";
        return names;
    }
};

struct Named {
    std::string name;
    Shot shot;
    bool slender = false; ///< float32 is not enough
};

inline Shot shot_of(std::vector<std::shared_ptr<const Field>> fields, const Camera& camera) {
    return {scene_of(std::move(fields)), camera};
}

/// Two planes and a box around most of it.
inline void clip(Scene& scene) {
    const Box box = scene.centres_world();
    const Vec3 size = box.extent(), centre = box.centre();
    const Vec3 tilted(1.0, -0.4, 0.3), steep(0.1, 0.2, -2.0);
    scene.clip.planes = {{tilted, glm::dot(tilted, centre - 0.21 * size)},
                         {steep, glm::dot(steep, centre + 0.17 * size)}};
    scene.clip.box = Box{centre - 0.47 * size, centre + 0.53 * size};
}

inline void cue(Scene& scene, const Camera& camera) {
    const double depth = -camera.to_eye(scene.centres_world().centre()).z;
    const double size = glm::length(scene.centres_world().extent());
    scene.depth_cue = DepthCue{depth - 0.3 * size, depth + 0.4 * size, Vec3(0.9, 0.7, 0.5), 0.8};
}

/// Scenes of the tests below, in every mode.
inline std::vector<Named> some_scenes() {
    const auto add_modes = [](std::vector<Named>& all, const std::string& name, const Shot& shot) {
        for (const Mode mode : {Mode::composite, Mode::isosurface, Mode::xray, Mode::mip}) {
            Named one{name + " mode " + std::to_string(static_cast<int>(mode)), shot};
            one.shot.scene.mode = mode;
            all.push_back(one);
            if (mode == Mode::composite) {
                one.name += " preintegration";
                one.shot.scene.preintegration = true;
                all.push_back(one);
                one.name += " and effects";
                one.shot.scene.second_order = true;
                one.shot.scene.gradient = Gradient::analytic;
                one.shot.scene.gradient_opacity = 0.5 / shot.scene.reference_distance();
                clip(one.shot.scene);
                cue(one.shot.scene, shot.camera);
                all.push_back(one);
            }
        }
    };
    std::vector<Named> all;
    const auto lattice = ball(12);
    const auto ellipsoids = cloud(150, 0.14, 5.0);
    add_modes(all, "lattice", shot_of({lattice}, askew(*lattice, Projection::perspective)));
    Shot shot = shot_of({ellipsoids}, askew(*ellipsoids, Projection::orthographic));
    shot.scene.slice_spacing = 0.05;
    add_modes(all, "ellipsoids", shot);
    shot.scene.fields.push_back(cloud(80, 0.12, 1.0, 9));
    shot.scene.opacity_stop = 0.9;
    shot.scene.transfer_function = test::dense();
    shot.outputs = {false, true};
    add_modes(all, "two fields", shot);
    return all;
}

} // namespace sheetsplat::backend_cpu
