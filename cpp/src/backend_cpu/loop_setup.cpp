#include "backend_cpu/loop_setup.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

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

} // namespace

template <class T>
LoopSetup<T> make_setup(const Job& job, const Shading<T>& shading) {
    const DrawPlan& plan = *job.plan;
    const Frame& frame = *job.frame;
    LoopSetup<T> setup;
    setup.shading = &shading;
    setup.keep_weight = plan.empty_test || plan.coverage;
    setup.slab = plan.sampling == Sampling::slab;
    setup.perspective = frame.projection == Projection::perspective;
    setup.intervals = uses_intervals(plan.mode, plan.preintegration);
    setup.stops = (plan.stop || plan.mode == Mode::isosurface) && !plan.coverage;
    setup.first_depth = frame.first_depth;
    setup.slice_spacing = frame.slice_spacing;
    // Channel 0 is rho in the end. Fields that share sheets add to it; each of the others has two of its own.
    setup.channels = 1;
    setup.threshold = plan.threshold;
    const bool shared_weight = plan.threshold || setup.keep_weight;
    if (shared_weight) {
        setup.weight_channel = setup.channels++;
    }
    const auto three = [&setup] {
        const int first = setup.channels;
        setup.channels += 3;
        return first;
    };
    const bool slopes = shading.analytic_gradient;
    if (slopes) {
        setup.slope_channel = three();
        setup.weight_slope_channel = shared_weight ? three() : -1;
    }
    const auto add_part = [&](std::size_t field) {
        const Field& source = *job.scene->fields[field];
        PartProfile<T> profile;
        const double k = source.kernel().falloff;
        profile.falloff_log2 = static_cast<T>(k * log2_e);
        profile.edge = static_cast<T>(source.kernel().edge());
        profile.root_falloff = static_cast<T>(std::sqrt(k));
        if (!plan.own_sheets.empty() && plan.own_sheets[field] >= 0) {
            OwnSheets<T> own;
            own.value_channel = profile.value_channel = setup.channels++;
            own.weight_channel = profile.weight_channel = setup.channels++;
            if (slopes) {
                own.slope_channel = profile.slope_channel = three();
                own.weight_slope_channel = profile.weight_slope_channel = three();
            }
            own.w0 = divisor<T>(source.w0());
            setup.own.push_back(own);
        } else {
            profile.value_channel = 0;
            profile.weight_channel = setup.weight_channel;
            profile.slope_channel = setup.slope_channel;
            profile.weight_slope_channel = setup.weight_slope_channel;
            if (plan.threshold) {
                setup.w0 = divisor<T>(source.w0());
            }
        }
        setup.parts.push_back(profile);
    };
    for (const RegularPart& part : job.regular) {
        add_part(part.field);
    }
    for (const EllipsoidPart& part : job.ellipsoids) {
        add_part(part.field);
    }
    return setup;
}

template LoopSetup<float> make_setup<float>(const Job&, const Shading<float>&);
template LoopSetup<double> make_setup<double>(const Job&, const Shading<double>&);

} // namespace sheetsplat::backend_cpu
