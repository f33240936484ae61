#include "plan/compute_path.hpp"

#include <algorithm>

#include "parts.hpp"
#include "plan/limits_gl.hpp"
#include "scene/mode_rules.hpp"

namespace sheetsplat {

using namespace gl_limits;

namespace {

/// Lattices of one scene that compute programs have volumes for: MOST_LATTICES of glsl/lib/interop.h.
constexpr int most_computed_lattices = 4;
/// Of a work group beside its sheets: flags, nodes of trees, places of lattices.
constexpr int other_bytes = 2048;
/// A kernel that waits to be added.
constexpr int kernel_bytes = 64;

} // namespace

int ComputeShape::bytes(int edge) const {
    const int points = edge * edge;
    return 2 * groups * planes * points * 16 + (scattered ? points / 2 * kernel_bytes + points * 4 : 0) + other_bytes;
}

int ComputeShape::edge(const Capabilities& capabilities) const {
    for (const int edge : {16, 8}) {
        if (bytes(edge) <= capabilities.compute_memory) {
            return edge;
        }
    }
    return 0;
}

ComputeShape compute_shape(const DrawPlan& plan, const Scene& scene) {
    const bool slopes = plan.fine_gradient || plan.analytic_gradient;
    ComputeShape shape;
    shape.groups = static_cast<int>(groups_drawn(scene).size());
    shape.planes = 1 + (plan.weight ? 1 : 0) + (slopes ? 3 : 0) + (slopes && plan.threshold ? 3 : 0);
    shape.border = plan.gradient && !plan.analytic_gradient ? 1 : 0;
    shape.divided = std::any_of(plan.own_sheets.begin(), plan.own_sheets.end(), [](int own) { return own >= 0; });
    shape.scattered = plan.filter || std::any_of(scene.fields.begin(), scene.fields.end(), [](const auto& field) {
                          return as_ellipsoids(field.get()) != nullptr;
                      });
    return shape;
}

std::string why_too_many(const Scene& scene, const Capabilities& capabilities) {
    std::size_t kernels = 0;
    for (const auto& field : scene.fields) {
        const EllipsoidField* scattered = as_ellipsoids(field.get());
        kernels += scattered != nullptr ? scattered->size() : 0;
    }
    // A call takes two steps at least; the tree over the kernels adds a little more than a 64th.
    const double turns = 2.0 * (1.0 + 1.0 / 60.0) * static_cast<double>(kernels);
    return capabilities.most_turns == 0 || turns <= turns_of_kernels(capabilities.most_turns)
               ? ""
               : std::to_string(kernels) + " scattered kernels may take more turns of loops than the " +
                     std::to_string(capabilities.most_turns) + " after which this driver ends them";
}

std::string why_not_computed(const Scene& scene, const Capabilities& capabilities, const DrawPlan& plan) {
    if (capabilities.compute_memory == 0) {
        return "OpenGL " + capabilities.version + " has no compute programs";
    }
    if (plan.packing != Packing::wide || plan.paper_slicing) {
        return "the forms of the papers are drawn by raster passes";
    }
    if (plan.precision != Precision::float32) {
        return std::string("sheets of ") + to_string(plan.precision) + " are drawn by raster passes";
    }
    if (plan.opacity_buffer) {
        return "the opacity buffer belongs to raster passes";
    }
    int lattices = 0;
    for (const auto& field : scene.fields) {
        const RegularField* lattice = as_regular(field.get());
        if (lattice == nullptr) {
            continue;
        }
        ++lattices;
        const auto& shape = lattice->shape();
        if (*std::max_element(shape.begin(), shape.end()) > static_cast<std::size_t>(capabilities.max_volume_size)) {
            return "a lattice is longer than the device's largest volume of " +
                   std::to_string(capabilities.max_volume_size) + " samples along an axis";
        }
    }
    if (lattices > most_computed_lattices) {
        return std::to_string(lattices) + " lattices are more than a compute program has volumes for";
    }
    if (compute_shape(plan, scene).edge(capabilities) == 0) {
        return "sheets of so many groups do not fit into a work group's " +
               std::to_string(capabilities.compute_memory) + " bytes";
    }
    return "";
}

} // namespace sheetsplat
