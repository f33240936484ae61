#include "facts/view_facts.hpp"

#include <cmath>

#include "facts/extreme_blocks.hpp"
#include "facts/lattice_section.hpp"
#include "scene/mode_rules.hpp"

namespace sheetsplat {

namespace {

FrameFacts frame_facts(const Frame& frame) {
    FrameFacts facts;
    facts.size = frame.size;
    facts.first_slice = frame.first_slice;
    facts.slices = frame.slices;
    facts.slice_spacing = frame.slice_spacing;
    facts.reference_length = frame.reference_length;
    facts.smallest_pixel = frame.slices > 0 ? frame.smallest_pixel() : frame.reference_length;
    facts.largest_pixel = frame.largest_pixel();
    facts.largest_slant = frame.largest_slant();
    facts.cut_by_near = frame.cut_by_near;
    facts.nearest_depth = frame.depth_of(0);
    // A crossing or an interval ends beyond its slice.
    facts.farthest_depth = frame.depth_of(frame.slices);
    return facts;
}

/// Longest way of a ray through a slab. With the filter, which makes kernels about as thick as a slab, the part of it
/// that goes sideways.
double way_through_slab(const Scene& scene, const Frame& frame) {
    return frame.slice_spacing * (scene.filter == Filter::none ? frame.largest_slant() : frame.largest_slope());
}

void add_lattice(const RegularField& field, const Scene& scene, const Camera& camera, const Frame& frame,
                 ViewFacts& facts) {
    const LatticeSection section = lattice_section(field, camera);
    facts.shapes.sheared = facts.shapes.sheared || section.sheared;
    const double thinnest = field.kernel_axes().least();
    const FilterWidth width =
        filter_width(frame, field.kernel(), frame.depth_of(std::max<std::int64_t>(frame.slices, 1) - 1));
    const double coarse = std::max(width.across, width.along);
    facts.shapes.largest_filtering = std::max(facts.shapes.largest_filtering, coarse * coarse / (thinnest * thinnest));
    facts.kernels.unresolved +=
        2.0 * thinnest < std::max(frame.smallest_pixel(), frame.slice_spacing) ? field.size() : 0;
    if (frame.slices == 0 || field.size() == 0) {
        return;
    }
    ScreenSizes& screen = facts.screen_px;
    screen.smallest = std::min(screen.smallest, thinnest / frame.largest_pixel());
    screen.largest_lattice = std::max(
        {screen.largest_lattice, section.extent_x / frame.smallest_pixel(), section.extent_y / frame.smallest_pixel()});
    // |w| ds / h: how far a ray gets through the unit sphere in one slab. Its part along n is ds / h; the smallest
    // semi-axis bounds it all.
    const double along = frame.slice_spacing / section.half_depth;
    const bool straight = frame.projection == Projection::orthographic && !section.sheared;
    const double across = straight ? along : frame.slice_spacing * facts.frame.largest_slant / thinnest;
    const double through = scene.filter == Filter::none && straight ? along : way_through_slab(scene, frame) / thinnest;
    facts.slabs.thickest = std::max(facts.slabs.thickest, through);
    facts.slabs.widest = std::max(facts.slabs.widest, std::sqrt(field.kernel().falloff) * std::max(along, across));
}

void add_ellipsoids(const EllipsoidField& field, const FieldSurvey& survey, const Scene& scene, const Camera& camera,
                    const Frame& frame, ViewFacts& facts) {
    const EllipsoidFacts own = survey_ellipsoids(field, survey.kernels, camera, frame);
    facts.kernels.ellipsoids = facts.kernels.ellipsoids || field.size() > 0;
    facts.kernels.most_ellipsoids = std::max(facts.kernels.most_ellipsoids, field.size());
    facts.kernels.unresolved += own.unresolved;
    facts.shapes.largest_aspect = std::max(facts.shapes.largest_aspect, survey.kernels.largest_aspect);
    facts.shapes.largest_filtering = std::max(facts.shapes.largest_filtering, own.largest_change);
    ScreenSizes& screen = facts.screen_px;
    screen.smallest_ellipsoid = std::min(screen.smallest_ellipsoid, own.smallest_px);
    screen.smallest = std::min(screen.smallest, own.smallest_px);
    if (frame.slices > 0) {
        screen.largest_ellipsoid = std::max(screen.largest_ellipsoid, field.scale_range()[1] / frame.smallest_pixel());
    }
    screen.largest_ellipsoid_at_unit = std::max(screen.largest_ellipsoid_at_unit, field.scale_range()[1] / frame.pixel);
    facts.overlap.typical = std::max(facts.overlap.typical, survey.kernels.mean_overlap);
    facts.overlap.densest = std::max(facts.overlap.densest, survey.kernels.crowd.overlap);
    facts.overlap.alike = std::max(facts.overlap.alike, survey.kernels.crowd.alike);
    facts.slabs.thickest = std::max(facts.slabs.thickest, way_through_slab(scene, frame) / survey.kernels.thinnest);
    if (scene.sampling == Sampling::slab && scene.filter == Filter::none) {
        const ThinInSlabs thin = survey_slabs(field, camera, frame, thick_slab);
        facts.slabs.ellipsoids.loss = std::max(facts.slabs.ellipsoids.loss, thin.loss);
        facts.slabs.ellipsoids.peak = std::max(facts.slabs.ellipsoids.peak, thin.peak);
    }
    if (survey.weights) {
        facts.weights.emplace(
            &field, scene.filter == Filter::none
                        ? *survey.weights
                        : survey_filtered_weights(field, filter_width(frame, field.kernel(), frame.first_depth)));
    }
}

} // namespace

ViewFacts view_facts(const Scene& scene, const Camera& camera, const Frame& frame, FieldSurveys& surveys) {
    ViewFacts facts;
    facts.frame = frame_facts(frame);
    facts.slabs.widest = 0.0;
    facts.screen_px.largest_lattice = 0.0;
    facts.overlap.typical = 0.0;
    facts.shapes.smallest_falloff = std::numeric_limits<double>::infinity();
    for (const auto& field : scene.fields) {
        facts.shapes.smallest_falloff = std::min(facts.shapes.smallest_falloff, field->kernel().falloff);
        facts.kernels.all += field->size();
        const FieldSurvey& survey = surveys.of(field);
        if (const EllipsoidField* ellipsoids = as_ellipsoids(field.get())) {
            add_ellipsoids(*ellipsoids, survey, scene, camera, frame, facts);
        } else {
            add_lattice(*as_regular(field.get()), scene, camera, frame, facts);
        }
        if (survey.lattice_peak) {
            facts.lattice_peaks.emplace(field.get(), *survey.lattice_peak);
        }
    }
    const RegularField* lattice = scene.fields.size() == 1 ? as_regular(scene.fields.front().get()) : nullptr;
    if (has_bounds(scene.mode) && lattice != nullptr && ExtremeBlocks::fit(*lattice)) {
        const auto peak = facts.lattice_peaks.find(lattice);
        facts.extremes =
            extreme_facts(*lattice, peak != facts.lattice_peaks.end() ? peak->second : 0.0, sign_of_extreme(scene.mode),
                          ExtremeBlocks::filled(scene), scene.clip.half_spaces(), camera, frame);
    }
    return facts;
}

} // namespace sheetsplat
