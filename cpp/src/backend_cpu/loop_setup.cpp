#include "backend_cpu/loop_setup.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "backend_cpu/number.hpp"
#include "plan/pivot.hpp"
#include "plan/tells_empty.hpp"
#include "scene/mode_rules.hpp"

namespace sheetsplat::backend_cpu {

namespace {

constexpr double log2_e = 1.4426950408889634;

/// w0 clamped to the positive normal numbers of the format, since sums of empty points are divided by it.
template <class T>
T divisor(double w0) {
    return static_cast<T>(std::clamp(w0, static_cast<double>(std::numeric_limits<T>::min()),
                                     static_cast<double>(std::numeric_limits<T>::max())));
}

/// The integral of exp(-k t^2) over 0 < t < s, divided by s, in powers of 2 s^2 - 1: by interpolation at Chebyshev's
/// points.
template <class T>
void integrate_profile(double k, PartProfile<T>& profile) {
    constexpr int terms = slab_terms<T>;
    profile.integrates = k <= largest_integrated_falloff;
    if (!profile.integrates) {
        return;
    }
    constexpr long double pi = 3.14159265358979323846L;
    const long double root = std::sqrt(static_cast<long double>(k));
    long double samples[terms];
    for (int n = 0; n < terms; ++n) {
        const long double place = std::cos(pi * (n + 0.5L) / terms);
        const long double s = std::sqrt(0.5L * (place + 1.0L));
        samples[n] = 0.5L * std::sqrt(pi) * std::erf(root * s) / (root * s);
    }
    // Chebyshev's polynomials in powers, each from the two before.
    long double sum[terms] = {}, here[terms] = {1.0L}, before[terms] = {};
    for (int order = 0; order < terms; ++order) {
        long double share = 0.0L;
        for (int n = 0; n < terms; ++n) {
            share += samples[n] * std::cos(pi * order * (n + 0.5L) / terms);
        }
        share *= (order == 0 ? 1.0L : 2.0L) / terms;
        long double next[terms] = {};
        for (int power = 0; power < terms; ++power) {
            sum[power] += share * here[power];
            next[power] = (power > 0 ? (order == 0 ? 1.0L : 2.0L) * here[power - 1] : 0.0L) - before[power];
        }
        std::copy(here, here + terms, before);
        std::copy(next, next + terms, here);
    }
    std::transform(sum, sum + terms, profile.integral, [](long double term) { return static_cast<T>(term); });
}

WholeLattice whole_lattice(const RestPart& rest, const Frame& frame) {
    const FieldView& view = *rest.view;
    WholeLattice whole;
    LatticeReach::add(view, frame, whole.parts);
    const double radius = whole.parts.front().radius();
    const Kernel& kernel = view.field->kernel();
    whole.falloff_log2 = kernel.falloff * log2_e / (radius * radius);
    whole.field = view.field;
    whole.layers = static_cast<double>(rest.layers);
    if (view.field->lattice() == Lattice::cartesian) {
        whole.reached =
            std::make_shared<const ReachedCells>(*view.field, *rest.runs, radius + WholeLattice::more_reach);
    }
    whole.edge = kernel.edge();
    whole.scale = view.value_scale;
    return whole;
}

} // namespace

template <class T>
LoopSetup<T> make_setup(const Job& job, const Shading<T>& shading) {
    const DrawPlan& plan = *job.plan;
    const Frame& frame = *job.frame;
    LoopSetup<T> setup;
    setup.shading = &shading;
    const bool counts = counts_weighted_slices(plan.mode), by_place = (counts || plan.empty_test) && !plan.weight;
    setup.counts_by_place = counts && by_place;
    setup.keep_weight = plan.coverage || tells_empty(plan);
    setup.slab = plan.sampling == Sampling::slab;
    setup.perspective = frame.projection == Projection::perspective;
    setup.intervals = uses_intervals(plan.mode, plan.preintegration);
    setup.stops = (plan.stop || shows_surfaces(plan.mode) || plan.depth_limit) && !plan.coverage;
    // (A pixel that ends looks at each slice.)
    const bool filled = job.scene->counted && job.scene->counted->filled;
    setup.sums_slices =
        (traits_of(plan.mode).integrates || (traits_of(plan.mode).mean && by_place && (filled || !plan.clip))) &&
        adds_all_fields(*job.scene) && !plan.owned && !setup.stops && !plan.coverage && !setup.slab &&
        !setup.perspective;
    setup.slices = frame.slices;
    setup.first_depth = frame.first_depth;
    setup.slice_spacing = frame.slice_spacing;
    setup.slopes = shading.analytic_gradient;
    const auto is_divided = [&](std::size_t field) {
        return plan.own_sheets.empty() ? plan.threshold : plan.own_sheets[field] >= 0;
    };
    // Gradients of quotients are next to nothing where values are alike: counted from the middle of the values, they
    // have no more rounding errors than what is left, and none where all values are one.
    const auto pivot = [&](std::size_t field) {
        return shading.gradient && is_divided(field)
                   ? number<T>(pivot_of(*job.scene->fields[field]) / plan.unit_of(field))
                   : T(0);
    };
    /// The group whose weights a field has too, that is summed beside another one.
    const auto weighs_as = [&](std::size_t field) -> const GroupSheets<T>* {
        for (const EllipsoidPart& part : job.ellipsoids) {
            if (part.beside && part.beside->field == field) {
                return &setup.groups[group_drawn_of(*job.scene, part.field)];
            }
        }
        return nullptr;
    };
    // A field that is all of its group is divided in the group's sheets; each of several has two of its own.
    const std::vector<Group> groups = groups_drawn(*job.scene);
    for (const GroupRange& set : label_sets(groups)) {
        setup.label_sets.push_back({set, setup.channels++});
    }
    for (const Group& group : groups) {
        GroupSheets<T> sheets;
        const auto take = [&](int count) { return sheets.take(setup.channels, count); };
        sheets.rho_channel = take(1);
        sheets.threshold = group.last - group.first == 1 && is_divided(group.first);
        const bool shared_weight = sheets.threshold || setup.keep_weight;
        const GroupSheets<T>* weighed = weighs_as(group.first);
        if (weighed != nullptr) {
            sheets.weight_channel = weighed->weight_channel;
        } else if (shared_weight) {
            sheets.weight_channel = take(1);
        }
        if (setup.slopes) {
            sheets.slope_channel = take(3);
            sheets.weight_slope_channel = shared_weight ? take(3) : -1;
        }
        if (sheets.threshold) {
            sheets.w0 = divisor<T>(job.scene->fields[group.first]->w0());
            sheets.pivot = pivot(group.first);
        }
        setup.groups.push_back(std::move(sheets));
    }
    const auto add_part = [&](std::size_t field) {
        const Field& source = *job.scene->fields[field];
        PartProfile<T> profile;
        profile.group = group_drawn_of(*job.scene, field);
        GroupSheets<T>& group = setup.groups[profile.group];
        const auto take = [&](int count) { return group.take(setup.channels, count); };
        const double k = source.kernel().falloff;
        profile.falloff_log2 = static_cast<T>(k * log2_e);
        profile.edge = static_cast<T>(source.kernel().edge());
        profile.root_falloff = static_cast<T>(std::sqrt(k));
        if (setup.slab) {
            integrate_profile(k, profile);
        }
        profile.pivot = static_cast<double>(pivot(field)) * plan.unit_of(field);
        if (!group.threshold && is_divided(field)) {
            OwnSheets<T> own;
            own.value_channel = profile.value_channel = take(1);
            own.weight_channel = profile.weight_channel = take(1);
            if (setup.slopes) {
                own.slope_channel = profile.slope_channel = take(3);
                own.weight_slope_channel = profile.weight_slope_channel = take(3);
            }
            own.w0 = divisor<T>(source.w0());
            own.least_weight = number<T>(source.least_weight());
            own.pivot = pivot(field);
            group.own.push_back(own);
        } else {
            profile.value_channel = group.rho_channel;
            profile.weight_channel = group.weight_channel;
            profile.slope_channel = group.slope_channel;
            profile.weight_slope_channel = group.weight_slope_channel;
        }
        setup.parts.push_back(profile);
    };
    for (const RegularPart& part : job.regular) {
        add_part(part.field);
        const auto add_reach = [&](const FieldView& view, std::size_t field) {
            if (by_place) {
                LatticeReach::add(view, frame, setup.groups[group_drawn_of(*job.scene, field)].reach);
            }
        };
        add_reach(*part.view, part.field);
        for (const LatticeBeside& beside : part.beside) {
            const std::size_t group = group_drawn_of(*job.scene, beside.field);
            setup.parts.back().beside.push_back({setup.groups[group].rho_channel, group});
            add_reach(*beside.view, beside.field);
        }
    }
    for (const EllipsoidPart& part : job.ellipsoids) {
        add_part(part.field);
        if (part.beside) {
            PartProfile<T>& profile = setup.parts.back();
            profile.other_group = group_drawn_of(*job.scene, part.beside->field);
            profile.other_channel = setup.groups[profile.other_group].rho_channel;
            profile.other_pivot = static_cast<double>(pivot(part.beside->field)) * plan.unit_of(part.beside->field);
        }
    }
    for (const RestPart& part : job.rests) {
        const std::size_t group = group_drawn_of(*job.scene, part.field);
        const auto set = std::find_if(setup.label_sets.begin(), setup.label_sets.end(), [&](const LabelSet& one) {
            return group >= one.groups.first && group < one.groups.last;
        });
        set->whole = whole_lattice(part, frame);
    }
    return setup;
}

bool finds_rests(const DrawPlan& plan, const FieldView& view) {
    return 2.0 * view.field->options().radius <= WholeLattice::most_samples && plan.sampling == Sampling::point &&
           !plan.filter && !plan.analytic_gradient && !plan.coverage && !tells_empty(plan);
}

bool sums_values_alone(const DrawPlan& plan) {
    return plan.sampling == Sampling::point && !plan.filter && !plan.analytic_gradient && !plan.coverage &&
           !plan.weight && !plan.threshold && plan.own_sheets.empty() && !is_scalar(plan.mode);
}

template <class T>
void sum_colors_at_points(const Job& job, LoopSetup<T>& setup, Shading<T>& shading) {
    const std::vector<Group> groups = groups_drawn(*job.scene);
    for (std::size_t part = 0; part < job.regular.size(); ++part) {
        const FieldView& view = *job.regular[part].view;
        const std::size_t number = group_drawn_of(*job.scene, job.regular[part].field);
        const Group& group = groups[number];
        const GroupSheets<T>& sheets = setup.groups[number];
        const Kernel& kernel = view.field->kernel();
        const double radius = view.field->options().radius;
        const bool by_sums = sheets.weight_channel < 0 && sheets.own.empty() && !view.field->has_holes();
        // (Kernels of BCC lattices, and those that a filter has widened, are no spheres in units of the samples.)
        const bool are_spheres = view.field->lattice() == Lattice::cartesian && !job.plan->filter;
        // Three components of a colour at each of many translucent points take longer than their sheets.
        const bool is_component = std::any_of(shading.groups.begin(), shading.groups.end(), [&](const auto& taking) {
            const GroupRange& range = taking.colors;
            return range.first <= number && number < range.last && range.last - range.first > 1;
        });
        if (group.use.role != GroupRole::colors || group.last - group.first != 1 || setup.record != nullptr ||
            setup.slab || !by_sums || !are_spheres || is_component || 2.0 * radius + 1.0 > PointLattice::most_samples) {
            continue;
        }
        PointLattice lattice;
        lattice.field = view.field;
        lattice.first_eye = view.first_eye;
        lattice.to_index = glm::inverse(glm::dmat3(view.step_i, view.step_j, view.step_k));
        lattice.radius = radius;
        lattice.falloff_log2 = kernel.falloff * log2_e / (radius * radius);
        lattice.edge = kernel.edge();
        lattice.counted_from = view.field->counted_from();
        lattice.value_scale = view.value_scale;
        shading.groups[number].summed_at_points = lattice;
        setup.parts[part].at_points = true;
    }
}

template void sum_colors_at_points<float>(const Job&, LoopSetup<float>&, Shading<float>&);
template void sum_colors_at_points<double>(const Job&, LoopSetup<double>&, Shading<double>&);
template LoopSetup<float> make_setup<float>(const Job&, const Shading<float>&);
template LoopSetup<double> make_setup<double>(const Job&, const Shading<double>&);

} // namespace sheetsplat::backend_cpu
