#include "light_drawing.hpp"

#include <algorithm>
#include <limits>

#include "light/grids.hpp"
#include "scene/mode_rules.hpp"

namespace sheetsplat {

namespace {

/// The plan with which the opacity along a light is computed: point sampling, no shading, no outputs beside opacity.
DrawPlan through(const DrawPlan& plan, const Scene& scene) {
    DrawPlan made = plan;
    made.mode = Mode::composite;
    made.sampling = Sampling::point;
    made.projection = Projection::orthographic;
    made.preintegration = made.second_order = false;
    made.gradient = made.lit = made.analytic_gradient = made.gradient_opacity = false;
    made.specular = made.two_sided = made.cut_faces = made.depth_cue = made.shadows = made.ambient_occlusion = false;
    made.stop = made.coverage = made.depth = false;
    made.depth_limit = false; // It belongs to the picture's rays.
    const std::vector<Group> groups = scene.groups();
    made.empty_test = std::any_of(groups.begin(), groups.end(), shows_at_base);
    made.weight = made.threshold || made.empty_test;
    return made;
}

/// The plan with which rho of a group of fields is sampled.
DrawPlan through_group(const DrawPlan& plan, const Scene& scene, const Group& group) {
    DrawPlan made = through(plan, scene);
    made.empty_test = false;
    made.field_units.clear(); // Iso values hold for all groups.
    made.own_sheets.assign(scene.fields.size(), -1);
    int divided = 0;
    for (std::size_t field = group.first; field < group.last; ++field) {
        if (scene.fields[field]->normalization() == Normalization::threshold) {
            made.own_sheets[field] = divided++;
        }
    }
    // A single quotient needs no sheets of its own.
    made.threshold = made.weight = divided > 0 && group.last - group.first == 1;
    if (divided == 0 || made.threshold) {
        made.own_sheets.clear();
    }
    return made;
}

/// Draws what is in a cut of a grid into its elements, which are 0. group: whose rho is drawn; null: absorption.
void fill(const LightGrid& grid, const LightCut& cut, const Group* group, const Request& asked,
          const Prepared& prepared, const Indexed& indexed, backend_cpu::CpuRenderer& processor, float* values) {
    Scene scene = asked.scene;
    scene.reference_length = scene.reference_distance();
    scene.slice_spacing = grid.spacing;
    scene.depth_limit.reset();
    DrawPlan plan = group == nullptr ? through(prepared.plan, scene) : through_group(prepared.plan, scene, *group);
    plan.owned = scene.part && group == nullptr;
    if (scene.part) {
        if (scene.part->cell.upright()) {
            constexpr double everywhere = std::numeric_limits<double>::infinity();
            scene.part->cell = Box{Vec3(-everywhere, -everywhere, cut.lower), Vec3(everywhere, everywhere, cut.upper)};
        }
        scene.part->in_front.reset();
        plan.owned = plan.owned && scene.part->cuts();
    }
    const std::vector<Group> groups = asked.scene.groups();
    GroupRange needed{};
    std::size_t recorded = 0;
    if (group != nullptr) {
        const auto own = static_cast<std::size_t>(
            std::find_if(groups.begin(), groups.end(), [&](const Group& one) { return one.first == group->first; }) -
            groups.begin());
        needed = {own, own + 1};
        for (const GroupRange& set : label_sets(groups)) {
            if (own >= set.first && own < set.last) {
                needed = set;
                recorded = own;
            }
        }
        if (!is_label(*group)) {
            scene.later_groups.clear(); // The fields of other groups are left out below.
        }
        if (scene.counted) {
            scene.counted->ends.clear(); // Lines look beyond the end of a field.
        }
    }
    const auto half = [](int count) { return 0.5 * (count - 1); };
    const double deep = 0.5 * static_cast<double>(cut.slices - 1) * grid.spacing;
    const Vec3 eye(grid.first.x + (cut.first[0] + half(cut.size.width)) * grid.step,
                   grid.first.y - (cut.first[1] + half(cut.size.height)) * grid.step,
                   grid.first.z - static_cast<double>(cut.first_slice) * grid.spacing - deep);
    const Camera camera = camera_along_z(eye, grid.step * cut.size.height);
    Frame frame;
    frame.projection = Projection::orthographic;
    frame.size = cut.size;
    frame.pixel = 2.0 * camera.half_height() / cut.size.height;
    frame.axis_x = 0.5 * cut.size.width;
    frame.axis_y = 0.5 * cut.size.height;
    frame.slice_spacing = grid.spacing;
    frame.reference_length = *scene.reference_length;
    frame.near = -std::numeric_limits<double>::infinity();
    frame.first_depth = -deep;
    frame.slices = cut.slices;

    const Request request = asked.with(scene);
    std::vector<FieldView> lattices;
    for (const std::size_t field : prepared.view_fields) {
        lattices.push_back(make_field_view(*as_regular(scene.fields[field].get()), camera, frame, Sampling::point,
                                           plan.unit_of(field), filter_of(plan)));
    }
    const std::vector<EllipsoidView> scattered = views_of(indexed, plan, camera, frame, Sampling::point);
    backend_cpu::Job job =
        cpu_job(request, prepared, indexed, lattices, scattered, camera, frame, plan, group == nullptr);
    // Light comes before the picture, of which nothing is done yet.
    const Progress nothing_yet =
        request.progress ? Progress([&request](double) { return request.progress(0.0); }) : Progress();
    job.progress = &nothing_yet;
    if (group == nullptr) {
        processor.absorb(job, grid.every, values);
        const std::size_t elements = cut.elements(grid);
        const auto per_slice = static_cast<float>(asked.scene.slice_distance() / grid.spacing / grid.every);
        std::transform(values, values + elements, values, [per_slice](float sum) { return per_slice * sum; });
        return;
    }
    const auto of_others = [&](const auto& part) {
        return part.field < groups[needed.first].first || part.field >= groups[needed.last - 1].last;
    };
    job.regular.erase(std::remove_if(job.regular.begin(), job.regular.end(), of_others), job.regular.end());
    job.rests.erase(std::remove_if(job.rests.begin(), job.rests.end(), of_others), job.rests.end());
    job.ellipsoids.erase(std::remove_if(job.ellipsoids.begin(), job.ellipsoids.end(), of_others), job.ellipsoids.end());
    processor.sample(job, recorded, values);
}

} // namespace

FillLight fill_light(const Request& request, const Prepared& prepared, const Indexed& indexed,
                     backend_cpu::CpuRenderer& processor) {
    return [&](const LightGrid& grid, const LightCut& cut, const Group* group, float* values) {
        fill(grid, cut, group, request, prepared, indexed, processor, values);
    };
}

} // namespace sheetsplat
