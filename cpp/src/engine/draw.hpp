// The steps from a request to a picture, and the drawing by each backend.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "backend_cpu/cpu_renderer.hpp"
#include "cost_model.hpp"
#include "field_index.hpp"
#include "plan/make_plan.hpp"
#include "probe.hpp"
#include "sheetsplat/image.hpp"
#include "sheetsplat/light_volume.hpp"
#include "sheetsplat/renderer.hpp"
#include "view/ellipsoid_view.hpp"
#include "view/field_view.hpp"

namespace sheetsplat {

/// A requested picture, and the options that it is drawn with.
struct Request {
    const Scene& scene;
    const Camera& camera;
    Size size{};
    const Outputs& outputs;
    const Progress& progress;
    const RendererOptions& options;
    const Excerpt* excerpt = nullptr; ///< null: the whole picture

    /// The same picture of another scene, or with other options.
    [[nodiscard]] Request with(const Scene& other) const {
        return {other, camera, size, outputs, progress, options, excerpt};
    }
    [[nodiscard]] Request with(const RendererOptions& other) const {
        return {scene, camera, size, outputs, progress, other, excerpt};
    }
};

/// Everything that is derived from scene, camera and size before a backend draws.
struct Prepared {
    Scene scene; ///< as CountedFields makes it of the request's
    Frame frame;
    DrawPlan plan;
    std::vector<FieldView> views;              ///< of the lattices, in the order of the scene's fields
    std::vector<std::size_t> view_fields;      ///< whose they are
    std::vector<std::size_t> ellipsoid_fields; ///< of scattered kernels
    Work work;
};

/// Two of Indexed::grids whose kernels differ in their values alone.
struct Twins {
    std::size_t first = 0, second = 0;
    std::vector<std::uint8_t> visible; ///< for either; empty: they have the same flags
};

/// A field of a label without a colour: its sums are those of all samples of the lattice less those of the other labels
/// of its set.
struct Rest {
    std::size_t field = 0;
    std::size_t layers = 0; ///< FieldIndex::share_samples
};

/// Lattices whose kernels differ in their values alone and that draw the same samples in good part: one walk is for
/// all.
struct Together {
    std::vector<std::size_t> parts;    ///< views; two or more
    const VisibleRuns* runs = nullptr; ///< of any
};

/// What is drawn: of each view's and each scattered field's kernels.
struct Indexed {
    std::vector<const RunsEntry*> runs;
    std::vector<const GridEntry*> grids;
    std::vector<std::size_t> grid_fields; ///< whose grids they are, in the scene
    std::vector<Twins> twins;             ///< a grid is one of at most two
    /// Fields of labels without a colour, one of a set: their sums are those of all samples of the lattice less those
    /// of the others in the set.
    std::vector<Rest> rests;        ///< one of a set of labels at most
    std::vector<Together> together; ///< a view is in one at most
    std::size_t visible = 0, all = 0, bytes = 0;
    LightVolumes volumes; ///< where the plan has shadows or ambient occlusion
};

inline Filter filter_of(const DrawPlan& plan) { return plan.filter ? Filter::ewa : Filter::none; }
/// Whether the kernels of lattices are drawn as those of lattices, and not one by one.
inline bool keeps_lattices(const DrawPlan& plan) {
    return !plan.filter || can(plan.summary.backend, Ability::filters_lattices);
}

/// Those of Indexed::grids. Throws OutOfMemory.
std::vector<Twins> find_twins(const std::vector<const GridEntry*>& grids, FieldIndex& index);

/// Those of Indexed::rests: of each set the one with the most visible samples. runs: of lattices, whose fields of the
/// scene are `fields`.
std::vector<Rest> find_rests(const Scene& scene, const std::vector<std::size_t>& fields,
                             const std::vector<const RunsEntry*>& runs, FieldIndex& index);

/// Those of Indexed::together, without Indexed::rests.
std::vector<Together> find_together(const Scene& scene, const std::vector<std::size_t>& fields, const Indexed& indexed,
                                    FieldIndex& index);

/// How the scattered kernels of a picture look to a camera, in the order of Indexed::grids. Refers to its arguments.
std::vector<EllipsoidView> views_of(const Indexed& indexed, const DrawPlan& plan, const Camera& camera,
                                    const Frame& frame, Sampling sampling);

/// The processor's job for a view, which refers to the arguments. one_walk: for all of Indexed::together.
backend_cpu::Job cpu_job(const Request& request, const Prepared& prepared, const Indexed& indexed,
                         const std::vector<FieldView>& lattices, const std::vector<EllipsoidView>& scattered,
                         const Camera& camera, const Frame& frame, const DrawPlan& plan, bool one_walk = true);

} // namespace sheetsplat
