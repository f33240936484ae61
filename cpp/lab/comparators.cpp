#include "lab/comparators.hpp"

#include <array>
#include <map>
#include <memory>
#include <optional>
#include <utility>

#include "backend_gl/embedded_glsl.hpp"
#include "backend_gl/slice_loop_hooks.hpp"
#include "fragment_counter.hpp"
#include "gather.hpp"
#include "lab_glsl.hpp"
#include "papers/opacity_buffer.hpp"
#include "preshaded.hpp"
#include "shader_variants.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat::lab {

namespace {

using backend_gl::Job;
using backend_gl::OpacityBuffer;
using backend_gl::Resources;
using backend_gl::ShaderVariant;
using backend_gl::SliceLoopHooks;
using backend_gl::Splatting;
using backend_gl::Targets;

constexpr std::array<std::pair<const char*, bool Comparators::*>, 9> names{{
    {"gather", &Comparators::gather},
    {"preshaded", &Comparators::preshaded},
    {"quads", &Comparators::quads},
    {"single_calls", &Comparators::single_calls},
    {"one_slab", &Comparators::one_slab},
    {"average_opacity", &Comparators::average_opacity},
    {"bare_fill", &Comparators::bare_fill},
    {"count_fragments", &Comparators::count_fragments},
    {"count_work", &Comparators::count_work},
}};

/// The product's GLSL files and the lab's.
const gl::SourceFiles& all_sources() {
    static const gl::SourceFiles files = [] {
        gl::SourceFiles all = backend_gl::embedded_glsl();
        all.insert(embedded_glsl().begin(), embedded_glsl().end());
        return all;
    }();
    return files;
}

/// [NM05] section 4.4: the mean opacity over a kernel's box.
class AverageOpacity : public OpacityBuffer {
  public:
    AverageOpacity(int width, int height, double opacity_stop) : OpacityBuffer(width, height, opacity_stop, 0) {}

  protected:
    [[nodiscard]] double measure(float alpha) const override { return static_cast<double>(alpha); }
    [[nodiscard]] bool is_opaque(double sum, double pixels) const override { return sum >= opacity_stop() * pixels; }
};

class Hooks : public SliceLoopHooks {
  public:
    explicit Hooks(const Comparators& on) : on_(on) {}

    void adjust(DrawPlan& plan, const Scene& scene) override {
        if (on_.gather) {
            adjust_for_gather(plan, scene);
        }
        if (on_.preshaded) {
            adjust_for_preshaded(plan, scene);
        }
        if (on_.one_slab) {
            plan.packing = Packing::paper;
        }
        if (on_.quads) {
            plan.points = false;
        }
    }
    BatchLayout layout(const BatchLayout& layout) override {
        return on_.one_slab || on_.preshaded ? BatchLayout{1, 1} : layout;
    }

    void begin_picture(const Job& job, const gl::Api& gl, Resources& resources) override {
        gl_ = &gl;
        resources_ = &resources;
        if (on_.gather) {
            const auto& first = job.ellipsoids.front();
            const Counting counting = backend_gl::counting_of(*job.plan, *job.scene)[first.field];
            gather_.emplace(gl, *first.view, *first.traversal, counting);
        }
        if (on_.count_fragments) {
            fragments_.emplace(gl);
        }
    }
    const gl::SourceFiles& sources() override { return all_sources(); }
    const Targets* draw_tile(const Job& job, const Tile& tile, const std::function<void(double)>& progress,
                             std::size_t& drawn) override {
        return on_.preshaded ? &draw_preshaded(job, *gl_, *resources_, tile, progress, drawn) : nullptr;
    }
    std::unique_ptr<OpacityBuffer> opacity_buffer(int width, int height, double opacity_stop) override {
        return on_.average_opacity ? std::make_unique<AverageOpacity>(width, height, opacity_stop) : nullptr;
    }
    void before_splats() override {
        if (fragments_) {
            fragments_->begin();
        }
    }
    void after_splats() override {
        if (fragments_) {
            fragments_->end();
        }
    }
    bool splat_ellipsoids(Splatting& splatting, std::size_t part, std::int64_t pass) override {
        if (gather_) {
            gather_->splat(splatting, part, pass);
        }
        return gather_.has_value();
    }
    void adjust_splats(ShaderVariant& variant) override {
        if (on_.bare_fill && variant.fragment == "ellipsoid.frag") {
            variant.fragment = "bare.frag";
        }
    }
    [[nodiscard]] std::size_t kernels_a_call() const override {
        return on_.single_calls ? 1 : SliceLoopHooks::kernels_a_call();
    }
    [[nodiscard]] bool shades() const override { return !on_.bare_fill; }
    [[nodiscard]] bool counts_work() const override { return on_.count_work; }

    void end_picture(Image& image) override {
        if (fragments_) {
            image.stats["fragments"] += static_cast<double>(fragments_->count());
        }
        if (gather_) {
            image.stats["bytes_device"] += static_cast<double>(gather_->bytes());
        }
        abandon_picture();
    }
    void abandon_picture() noexcept override {
        gather_.reset();
        fragments_.reset();
    }

  private:
    const Comparators on_;
    const gl::Api* gl_ = nullptr;
    Resources* resources_ = nullptr;
    std::optional<Gather> gather_;
    std::optional<FragmentCounter> fragments_;
};

} // namespace

std::vector<std::string> comparator_names() {
    std::vector<std::string> result;
    for (const auto& one : names) {
        result.emplace_back(one.first);
    }
    return result;
}

Comparators comparators_of(const std::vector<std::string>& wanted) {
    Comparators comparators;
    for (const std::string& name : wanted) {
        bool found = false;
        for (const auto& [known, member] : names) {
            if (name == known) {
                comparators.*member = found = true;
            }
        }
        if (!found) {
            std::string all;
            for (const auto& one : names) {
                all += (all.empty() ? "" : ", ") + std::string(one.first);
            }
            throw InvalidInput(
                Complaint{"the comparators cannot be used", "the name \"" + name + "\"", "of " + all, "correct it"});
        }
    }
    return comparators;
}

Image render(Renderer& renderer, const Comparators& comparators, const Scene& scene, const Camera& camera, Size size,
             const Outputs& outputs, const Progress& progress) {
    Hooks hooks(comparators);
    const backend_gl::InstalledHooks installed(hooks);
    return renderer.render(scene, camera, size, outputs, progress);
}

} // namespace sheetsplat::lab
