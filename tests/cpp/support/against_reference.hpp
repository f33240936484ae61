// Pictures of the backends gl and cpu against those of the float64 reference.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <ostream>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "sheetsplat/device.hpp"
#include "sheetsplat/renderer.hpp"

namespace sheetsplat::testing {

inline bool gl_available() {
    static const bool available = [] {
        const auto reports = devices();
        return std::any_of(reports.begin(), reports.end(),
                           [](const DeviceReport& report) { return report.backend == "gl" && report.available; });
    }();
    return available;
}

/// Skips its tests where there is no OpenGL.
class WithGl : public ::testing::Test {
  protected:
    void SetUp() override {
        if (!gl_available()) {
            GTEST_SKIP() << "no OpenGL context can be made here";
        }
    }
};

/// What draws: a backend, and on gl how slices lie in its buffers.
enum class Way { wide, paper, cpu };
inline const char* to_string(Way way) { return way == Way::wide ? "wide" : way == Way::paper ? "paper" : "cpu"; }

inline RendererOptions options_of(Way way) {
    RendererOptions options;
    options.backend = way == Way::cpu ? Backend::cpu : Backend::gl;
    options.packing = way == Way::paper ? Packing::paper : way == Way::wide ? Packing::wide : Packing::automatic;
    return options;
}

/// A way to draw whose picture must be the same as every other's.
struct Draw {
    const char* name;
    Packing packing = Packing::wide;
    Tagging tagging = Tagging::automatic;
    std::map<std::string, bool> effects{};
    int tile_size = 0;
    int tags_per_clear = 0;
    Backend backend = Backend::gl;
    Precision precision = Precision::automatic;
    int threads = 0;
};
inline std::ostream& operator<<(std::ostream& out, const Draw& draw) { return out << draw.name; }

inline Draw on_cpu(const char* name, int tile_size = 0, Precision precision = Precision::automatic, int threads = 0,
                   std::map<std::string, bool> effects = {}) {
    return {name,   Packing::automatic, Tagging::automatic, std::move(effects), tile_size, 0, Backend::cpu, precision,
            threads};
}

inline RendererOptions options_of(const Draw& draw) {
    RendererOptions options;
    options.backend = draw.backend;
    options.precision = draw.precision;
    options.threads = draw.threads;
    options.packing = draw.packing;
    options.tagging = draw.tagging;
    options.effects = draw.effects;
    options.tile_size = draw.tile_size;
    options.tags_per_clear = draw.tags_per_clear;
    return options;
}

inline Image by_reference(const Scene& scene, const Camera& camera, Size size, const Outputs& outputs = {}) {
    RendererOptions exact;
    exact.backend = Backend::reference;
    return Renderer(exact).render(scene, camera, size, outputs);
}

/// Expects something to be seen: a value, colour or opacity of the reference's picture above `least`.
inline Difference between(const Image& picture, const Image& judge, const std::string& name, double least = 0.01) {
    const bool scalar = !judge.scalar.empty();
    double largest = 0.0;
    for (float value : scalar ? judge.scalar : judge.rgba) {
        largest = std::max(largest, std::abs(double(value)));
    }
    EXPECT_GT(largest, least) << name;
    const Difference difference =
        scalar ? compare(picture.scalar, judge.scalar, 1) : compare(picture.rgba, judge.rgba, 4);
    std::printf("%-70s rmse %.2e p99.9 %.2e max %.2e (largest %.3f)\n", name.c_str(), difference.rmse, difference.p99_9,
                difference.maximum, largest);
    return difference;
}

/// A view of a scene with the reference's picture of it, drawn once for every way of drawing that it judges.
class Judged {
  public:
    Judged(Scene scene, Camera camera, Size size, Outputs outputs = {}, double least = 0.01)
        : scene_(std::move(scene)), camera_(std::move(camera)), size_(size), outputs_(outputs), least_(least),
          judge_(by_reference(scene_, camera_, size_, outputs_)) {}

    /// Draws the view; where the judge has coverage, it is compared too, unless `with_outputs` is false.
    [[nodiscard]] Difference from(const RendererOptions& options, const std::string& name,
                                  bool with_outputs = true) const {
        const Image picture = Renderer(options).render(scene_, camera_, size_, with_outputs ? outputs_ : Outputs{});
        EXPECT_EQ(picture.plan->backend, options.backend) << name;
        if (outputs_.coverage && with_outputs) {
            EXPECT_LT(compare(picture.coverage, judge_.coverage, 1).rmse, 2e-5) << name << " coverage";
        }
        return between(picture, judge_, name + " " + to_string(options.backend), least_);
    }

  private:
    Scene scene_;
    Camera camera_;
    Size size_;
    Outputs outputs_;
    double least_;
    Image judge_;
};

/// The ways to draw that are possible here.
inline std::vector<Way> ways() {
    return gl_available() ? std::vector<Way>{Way::wide, Way::paper, Way::cpu} : std::vector<Way>{Way::cpu};
}

} // namespace sheetsplat::testing
