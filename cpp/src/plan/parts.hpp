// The parts of make_plan: what follows from the scene, and what each backend adds.
#pragma once

#include <cstdint>
#include <string>

#include "base/checks.hpp"
#include "effects.hpp"
#include "error_model.hpp"
#include "plan/make_plan.hpp"

namespace sheetsplat {

/// A number for a sentence.
inline std::string number(double value) { return text_of(value, 4); }
inline std::string kernels(std::size_t count) { return text_of_count(count, "kernel"); }

/// Several fields of which one is divided by its weight sum: each of these gets its own sheets. always: a single one
/// does too.
void divide_apart(const Scene& scene, const Outputs& outputs, Effects& effects, DrawPlan& plan, bool always = false);

/// What the shared part of make_plan found that a way of drawing depends on.
struct SceneCalls {
    bool lattices = false; ///< some field is drawn as a lattice
    bool spheres = false;  ///< some field is drawn as spheres of its own
    bool stops = false;    ///< pixels can become opaque enough to stop
    double opacity = 1.0;  ///< largest that occurs
};

/// Largest falloff of fields that have kernels.
double steepest_falloff(const Scene& scene);

/// True where opacity can reach A_stop along some ray within this many slices, or intervals, of at most `opacity` each.
bool saturates_within(const Scene& scene, const ViewFacts& view, std::int64_t slices, double opacity);

/// What a backend's part of make_plan looks at.
struct PlanInputs {
    const Scene& scene;
    const ViewFacts& view;
    const RendererOptions& options;
    const Outputs& outputs;
    const Capabilities* capabilities; ///< Painter::capabilities
    SceneCalls calls;
};

// plan_X of each backend: its part of make_plan. `plan` holds what follows from the scene already. Throws Unsupported.
#define SHEETSPLAT_DECLARE_PLANNER(name, ...)                                                                          \
    void plan_##name(const PlanInputs& inputs, Effects& effects, DrawPlan& plan);
SHEETSPLAT_BACKENDS(SHEETSPLAT_DECLARE_PLANNER)
#undef SHEETSPLAT_DECLARE_PLANNER

} // namespace sheetsplat
