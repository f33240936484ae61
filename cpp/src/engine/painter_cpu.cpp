// Backend cpu as the engine asks for it, and the processor in words.
#include "painters.hpp"

#include "base/checks.hpp"
#include "base/clock.hpp"
#include "base/instruction_set.hpp"
#include "base/poll.hpp"
#include "base/threads.hpp"

namespace sheetsplat {

namespace {

class CpuPainter : public Painter {
  public:
    explicit CpuPainter(backend_cpu::CpuRenderer& renderer) : renderer_(renderer) {}

    [[nodiscard]] std::string description(int threads) const override { return describe_cpu(thread_count(threads)); }
    void draw(const Request& request, const Prepared& prepared, const Indexed& indexed, Image& image,
              std::vector<float>&) override {
        const auto viewing = Clock::now();
        const std::vector<EllipsoidView> scattered =
            views_of(indexed, prepared.plan, request.camera, prepared.frame, request.scene.sampling);
        backend_cpu::Job job = cpu_job(request, prepared, indexed, prepared.views, scattered, request.camera,
                                       prepared.frame, prepared.plan);
        job.volumes = &indexed.volumes;
        if (request.excerpt != nullptr) {
            job.tile_size = request.excerpt->edge;
            job.drawn_tiles = &request.excerpt->drawn;
        }
        image.stats["seconds_view"] = seconds_since(viewing);
        // Short pictures end before the first poll.
        report_progress(request.progress, 0.0);
        renderer_.render(job, image);
        report_progress(request.progress, 1.0);
    }

  private:
    backend_cpu::CpuRenderer& renderer_;
};

} // namespace

int thread_count(int asked) { return asked > 0 ? asked : usable_threads(); }

std::string describe_cpu(int threads) {
    return instruction_set() + ", " + text_of_count(static_cast<std::uint64_t>(threads), "thread");
}

std::unique_ptr<Painter> make_cpu_painter(const Devices& devices) {
    return std::make_unique<CpuPainter>(devices.processor);
}

std::vector<DeviceReport> survey_cpu() {
    DeviceReport report;
    report.backend = traits_of(Backend::cpu).name;
    report.available = true;
    report.description = describe_cpu(thread_count(0));
    report.extensions = instruction_sets();
    return {report};
}

} // namespace sheetsplat
