// Threads that draw at once: renderers that they share, each behind a lock as the Python module has one, and renderers
// of their own for fields that they share. Every picture has the bits of one that is drawn alone.
#include <array>
#include <atomic>
#include <functional>
#include <memory>
#include <mutex>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "sheetsplat/error.hpp"
#include "sheetsplat/renderer.hpp"
#include "support/draws.hpp"
#include "support/lattices.hpp"

namespace sheetsplat {
namespace {

constexpr int threads = 8;
constexpr Size size{40, 36};

std::shared_ptr<const RegularField> noise() {
    constexpr std::size_t n = 12;
    std::mt19937 random(5);
    std::uniform_real_distribution<float> uniform(0.0F, 1.0F);
    std::vector<float> samples(n * n * n);
    for (float& sample : samples) {
        sample = uniform(random);
    }
    return std::make_shared<RegularField>(std::move(samples), std::array<std::size_t, 3>{n, n, n},
                                          test::zero_boundary());
}

std::shared_ptr<const EllipsoidField> cloud() {
    std::mt19937 random(7);
    std::uniform_real_distribution<double> uniform(0.0, 1.0);
    EllipsoidArrays arrays;
    for (int i = 0; i < 150; ++i) {
        arrays.centers.push_back(12.0 * test::three([&] { return uniform(random); }));
        arrays.values.push_back(uniform(random));
        arrays.radii.push_back(0.8 + uniform(random));
    }
    return std::make_shared<EllipsoidField>(std::move(arrays));
}

/// Pictures of two fields that differ in everything that a renderer keeps.
struct View {
    Scene scene;
    Camera camera;
};

std::vector<View> views() {
    const auto lattice = noise();
    const auto spheres = cloud();
    const TransferFunction gentle({{0.0, {0.1, 0.2, 0.9}, 0.0}, {1.0, {1.0, 0.8, 0.2}, 0.4}});
    const TransferFunction steep({{0.4, {0.1, 0.9, 0.2}, 0.0}, {0.6, {1.0, 0.3, 0.2}, 0.9}});
    const auto from = [](const Field& field, const Vec3& direction, Projection projection) {
        return Camera::fit(field.supports_world(), direction, Vec3(0, 1, 0), projection);
    };
    const auto lit = [](Scene scene) {
        scene.lights = {Light{{0.3, 0.5, 1.0}, {1.0, 1.0, 1.0}, LightSpace::eye}};
        return scene;
    };
    std::vector<View> made{
        {Scene{{lattice}, gentle}, from(*lattice, {-0.5, -0.3, -0.8}, Projection::orthographic)},
        {lit(Scene{{lattice}, steep}), from(*lattice, {0.2, -0.3, -0.8}, Projection::perspective)},
        {Scene{{spheres}, steep}, from(*spheres, {-0.5, 0.4, -0.8}, Projection::orthographic)},
        {lit(Scene{{spheres, lattice}, gentle}), from(*spheres, {-0.5, 0.4, -0.8}, Projection::perspective)},
    };
    made.push_back(made[1]);
    made.back().scene.shadows = true;
    made.push_back(made[2]);
    made.back().scene.mode = Mode::isosurface;
    made.back().scene.iso_values = {0.3};
    return made;
}

RendererOptions on(Backend backend, int of_its_own) {
    RendererOptions options;
    options.backend = backend;
    options.threads = of_its_own;
    return options;
}

class Threads : public testing::TestWithParam<Backend> {
  protected:
    void SetUp() override {
        try {
            Renderer probe(on(GetParam(), 1));
            for (const View& view : views_) {
                alone_.push_back(probe.render(view.scene, view.camera, size).rgba);
            }
        } catch (const DeviceUnavailable& error) {
            GTEST_SKIP() << error.what();
        }
    }

    /// Runs work(thread) in all threads at once; what one throws is thrown here.
    static void run(const std::function<void(int)>& work) {
        std::vector<std::thread> all;
        std::array<std::exception_ptr, threads> thrown{};
        for (int thread = 0; thread < threads; ++thread) {
            all.emplace_back([&work, &thrown, thread] {
                try {
                    work(thread);
                } catch (...) {
                    thrown[static_cast<std::size_t>(thread)] = std::current_exception();
                }
            });
        }
        for (std::thread& one : all) {
            one.join();
        }
        for (const std::exception_ptr& one : thrown) {
            if (one) {
                std::rethrow_exception(one);
            }
        }
    }

    const std::vector<View> views_ = views();
    std::vector<std::vector<float>> alone_;
};

TEST_P(Threads, ShareRenderers) {
    struct Shared {
        Renderer renderer;
        std::mutex mutex;
        explicit Shared(const RendererOptions& options) : renderer(options) {}
    };
    std::vector<std::unique_ptr<Shared>> shared;
    for (const int of_its_own : {1, 2, 3}) {
        shared.push_back(std::make_unique<Shared>(on(GetParam(), of_its_own)));
    }
    std::atomic<int> different{0}, drawn{0};
    run([&](int thread) {
        for (std::size_t n = 0; n < views_.size(); ++n) {
            const std::size_t which =
                (n * static_cast<std::size_t>(thread % 3 + 1) + static_cast<std::size_t>(thread)) % views_.size();
            Shared& one = *shared[(n + static_cast<std::size_t>(thread)) % shared.size()];
            const std::lock_guard<std::mutex> lock(one.mutex);
            different += one.renderer.render(views_[which].scene, views_[which].camera, size).rgba != alone_[which];
            ++drawn;
        }
    });
    EXPECT_EQ(different, 0);
    EXPECT_EQ(drawn, threads * static_cast<int>(views_.size()));
}

TEST_P(Threads, ShareFieldsAndScenes) {
    std::atomic<int> different{0};
    run([&](int thread) {
        Renderer own(on(GetParam(), 2));
        for (std::size_t n = 0; n < 3; ++n) {
            const std::size_t which = (n + static_cast<std::size_t>(thread)) % views_.size();
            const View& view = views_[which];
            const Image image = own.render(view.scene, view.camera, size);
            different += image.rgba != alone_[which];
            if (n == 0 && thread % 4 == 0) {
                different += !(own.estimate_error(image, view.scene, view.camera).rmse >= 0.0);
            }
        }
    });
    EXPECT_EQ(different, 0);
}

TEST_P(Threads, CancelWithoutTroubleToOthers) {
    std::atomic<int> cancelled{0}, different{0};
    run([&](int thread) {
        Renderer own(on(GetParam(), 2));
        for (int n = 0; n < 2; ++n) {
            const View& view = views_[0];
            if (thread % 2 == 0) {
                try {
                    static_cast<void>(own.render(view.scene, view.camera, size, {}, [](double) { return false; }));
                } catch (const Cancelled&) {
                    ++cancelled;
                }
            }
            different += own.render(view.scene, view.camera, size).rgba != alone_[0];
        }
    });
    EXPECT_EQ(cancelled, threads);
    EXPECT_EQ(different, 0);
}

INSTANTIATE_TEST_SUITE_P(Backends, Threads, testing::Values(Backend::cpu, Backend::gl, Backend::reference),
                         [](const auto& chosen) { return std::string(to_string(chosen.param)); });

} // namespace
} // namespace sheetsplat
