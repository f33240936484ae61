// Plans whose scenes are just within a limit or just beyond it.
#pragma once

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "plan/make_plan.hpp"
#include "sheetsplat/error.hpp"
#include "support/facts.hpp"
#include "support/lattices.hpp"

namespace sheetsplat::test {

/// Everything that a plan is made of.
struct Case {
    Scene scene;
    ViewFacts view;
    RendererOptions options;
    Projection projection = Projection::orthographic;
    Capabilities device;

    [[nodiscard]] DrawPlan plan(Backend backend) const {
        return make_plan(scene, surveyed(scene, view), options, {}, projection, backend,
                         backend == Backend::gl ? &device : nullptr);
    }
    [[nodiscard]] bool refused(Backend backend) const {
        try {
            (void)plan(backend);
            return false;
        } catch (const Unsupported&) {
            return true;
        }
    }
};

/// A limit, a number on either side of it, and the case that has that number.
struct Limit {
    std::string name;
    double within, beyond;
    std::function<void(Case&, double)> set;
};
inline std::ostream& operator<<(std::ostream& out, const Limit& limit) { return out << limit.name; }
inline std::string name_of(const testing::TestParamInfo<Limit>& info) { return info.param.name; }

inline std::shared_ptr<const Field> lattice(Normalization normalization = Normalization::lattice, double offset = 0.0,
                                            double falloff = 5.0) {
    RegularFieldOptions options = test::zero_boundary();
    options.normalization = normalization;
    options.falloff = falloff;
    std::vector<double> samples{0.0, 1.0, 0.5, 0.2, 0.1, 0.9, 0.3, 0.4};
    for (double& sample : samples) {
        sample += offset;
    }
    return std::make_shared<RegularField>(std::move(samples), std::array<std::size_t, 3>{2, 2, 2}, options);
}

inline std::shared_ptr<const Field> ellipsoids(double w0 = 1.0, double weight = 1.0, double distance = 1.0,
                                               double falloff = 5.0, double offset = 0.0) {
    EllipsoidArrays arrays;
    arrays.centers = {Vec3(0.0), Vec3(distance, 0.0, 0.0)};
    arrays.scales = {Vec3(1.0, 0.5, 2.0), Vec3(1.0, 0.5, 2.0)};
    arrays.values = {0.5 + offset, 0.7 + offset};
    arrays.weights = {weight, weight};
    EllipsoidFieldOptions options;
    options.normalization = Normalization::threshold;
    options.w0 = w0;
    options.falloff = falloff;
    return std::make_shared<EllipsoidField>(std::move(arrays), options);
}

/// Opacity rises by `slope` a unit of value, up to `top`, from the value `from` on; the window is 1 wide.
inline TransferFunction ramp(double slope, double top = 0.01, double from = 0.0) {
    const double end = std::min(top / slope, 1.0);
    std::vector<TransferPoint> points{{from, {1, 1, 1}, 0.0}, {from + end, {1, 1, 1}, std::min(top, slope)}};
    if (end < 1.0) {
        points.push_back({from + 1.0, {1, 1, 1}, std::min(top, slope)});
    }
    return TransferFunction(std::move(points));
}

inline Case lit_case(std::shared_ptr<const Field> field = lattice()) {
    Case made{Scene{{std::move(field)}, ramp(0.01)}, {}, {}, Projection::orthographic, {}};
    made.scene.lights = {Light{}};
    made.view.frame.size = {64, 64};
    made.view.frame.slices = 6;
    made.view.kernels.all = 8;
    made.view.screen_px.smallest = 2.0;
    made.view.shapes.smallest_falloff = 5.0;
    made.device.renderer = "a device";
    made.device.version = "4.6";
    made.device.version_major = 4;
    made.device.version_minor = 6;
    made.device.max_point_size = 255.0F;
    made.device.max_buffer_texels = 1 << 27;
    return made;
}

inline void make_unlit(Case& one) { one.scene.lights.clear(); }
inline void make_quotients(Case& one) { one.scene.fields = {lattice(Normalization::threshold)}; }

} // namespace sheetsplat::test
