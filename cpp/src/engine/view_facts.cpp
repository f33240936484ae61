#include "view_facts.hpp"

#include <algorithm>
#include <cmath>

#include "index/visible_runs.hpp"

namespace sheetsplat {

namespace {

void add_facts(const RegularField& field, const Scene& scene, const Camera& camera, const Frame& frame,
               ViewFacts& facts) {
    const FieldView view = make_field_view(field, camera, frame, scene.sampling, 1.0);
    facts.sheared = facts.sheared || view.sheared;
    const Vec3 axes = field.semi_axes_world();
    const double thinnest = std::min({axes.x, axes.y, axes.z});
    const double coarse = std::max(frame.largest_pixel(), frame.slice_spacing);
    facts.largest_filtering = std::max(facts.largest_filtering, coarse * coarse / (thinnest * thinnest));
    facts.unresolved += 2.0 * thinnest < std::max(frame.smallest_pixel(), frame.slice_spacing) ? field.size() : 0;
    if (frame.slices == 0 || field.size() == 0) {
        return;
    }
    facts.smallest_radius_px = std::min(facts.smallest_radius_px, thinnest / frame.largest_pixel());
    facts.largest_splat_px = std::max(
        {facts.largest_splat_px, view.extent_x / frame.smallest_pixel(), view.extent_y / frame.smallest_pixel()});
    // |w| ds / h: how far a ray gets through the unit sphere in one slab. Its part along n is ds / h; the smallest
    // semi-axis bounds it all.
    const double along = frame.slice_spacing / view.half_depth;
    const double across = frame.projection == Projection::perspective || view.sheared
                              ? frame.slice_spacing * facts.largest_slant / thinnest
                              : along;
    facts.thickest_slab = std::max(facts.thickest_slab, along);
    facts.widest_slab = std::max(facts.widest_slab, std::sqrt(field.kernel().falloff) * std::max(along, across));
}

void add_facts(const EllipsoidField& field, const FieldFacts::Entry& known, const Scene& scene, const Camera& camera,
               const Frame& frame, ViewFacts& facts) {
    const EllipsoidFacts own = survey_ellipsoids(field, known.kernels, camera, frame);
    facts.ellipsoids = facts.ellipsoids || field.size() > 0;
    facts.unresolved += own.unresolved;
    facts.largest_aspect = std::max(facts.largest_aspect, own.largest_aspect);
    facts.smallest_px = std::min(facts.smallest_px, own.smallest_px);
    facts.smallest_radius_px = std::min(facts.smallest_radius_px, own.smallest_px);
    facts.thickest_slab = std::max(facts.thickest_slab, frame.slice_spacing / known.kernels.thinnest);
    if (frame.slices > 0) {
        facts.largest_radius_px = std::max(facts.largest_radius_px, field.scale_range()[1] / frame.smallest_pixel());
    }
    facts.most_ellipsoids = std::max(facts.most_ellipsoids, field.size());
    facts.largest_filtering = std::max(facts.largest_filtering, own.largest_change);
    facts.largest_overlap = std::max(facts.largest_overlap, own.mean_overlap);
    facts.largest_px = std::max(facts.largest_px, field.scale_range()[1] / frame.pixel);
    facts.densest_overlap = std::max(facts.densest_overlap, known.kernels.crowd.overlap);
    facts.most_alike = std::max(facts.most_alike, known.kernels.crowd.alike);
    if (scene.sampling == Sampling::slab && scene.filter == Filter::none) {
        const ThinInSlabs thin = survey_slabs(field, camera, frame, thick_slab);
        facts.thin_loss = std::max(facts.thin_loss, thin.loss);
        facts.thin_peak = std::max(facts.thin_peak, thin.peak);
    }
    facts.largest_weight = std::max(facts.largest_weight, field.weight_range()[1]);
    if (known.weights) {
        facts.weights.emplace(&field, *known.weights);
    }
}

} // namespace

double largest_slant(const Frame& frame) {
    if (frame.projection == Projection::orthographic) {
        return 1.0;
    }
    const double x = 0.5 * frame.pixel * frame.size.width;
    const double y = 0.5 * frame.pixel * frame.size.height;
    return std::sqrt(1.0 + x * x + y * y);
}

const FieldFacts::Entry& FieldFacts::of(const std::shared_ptr<const Field>& field) {
    for (const auto& entry : entries_) {
        if (entry->field == field) {
            return *entry;
        }
    }
    auto made = std::make_unique<Entry>();
    made->field = field;
    if (const EllipsoidField* ellipsoids = as_ellipsoids(field.get())) {
        made->kernels = survey_kernels(*ellipsoids);
        if (!ellipsoids->arrays().weights.empty()) {
            made->weights = survey_weights(*ellipsoids);
        }
    }
    if (const RegularField* regular = as_regular(field.get()); regular != nullptr && regular->size() > 0) {
        made->peak = lattice_ripple(*regular).upper;
    }
    entries_.push_back(std::move(made));
    return *entries_.back();
}

void FieldFacts::forget_others(const Scene& scene) {
    entries_.erase(std::remove_if(entries_.begin(), entries_.end(),
                                  [&](const std::unique_ptr<Entry>& entry) {
                                      return std::find(scene.fields.begin(), scene.fields.end(), entry->field) ==
                                             scene.fields.end();
                                  }),
                   entries_.end());
}

ViewFacts facts_of(const Scene& scene, const Camera& camera, const Frame& frame, FieldFacts& fields) {
    ViewFacts facts;
    facts.size = frame.size;
    facts.first_slice = frame.first_slice;
    facts.slices = frame.slices;
    facts.slice_spacing = frame.slice_spacing;
    facts.reference_length = frame.reference_length;
    facts.smallest_pixel = frame.slices > 0 ? frame.smallest_pixel() : frame.reference_length;
    facts.largest_pixel = frame.largest_pixel();
    facts.largest_slant = largest_slant(frame);
    facts.cut_by_near = frame.cut_by_near;
    // A crossing or an interval lies beyond its slice.
    facts.nearest_depth = frame.depth_of(-1);
    facts.farthest_depth = frame.depth_of(frame.slices);
    facts.widest_slab = 0.0;
    facts.largest_splat_px = 0.0;
    facts.largest_overlap = 0.0;
    bool first = true;
    for (const auto& field : scene.fields) {
        const double falloff = field->kernel().falloff;
        facts.smallest_falloff = first ? falloff : std::min(facts.smallest_falloff, falloff);
        first = false;
        facts.kernels += field->size();
        if (const EllipsoidField* ellipsoids = as_ellipsoids(field.get())) {
            add_facts(*ellipsoids, fields.of(field), scene, camera, frame, facts);
        } else {
            add_facts(*as_regular(field.get()), scene, camera, frame, facts);
            if (const auto& peak = fields.of(field).peak) {
                facts.lattice_peaks.emplace(field.get(), *peak);
            }
        }
    }
    return facts;
}

} // namespace sheetsplat
