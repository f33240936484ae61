// Backend gl as the engine asks for it: batches and walks through cells for views, drawn by a device.
#include "device_rates.hpp"
#include "painters.hpp"

#include "backend_gl/gl_renderer.hpp"
#include "base/clock.hpp"
#include "view/cell_walk.hpp"
#include "view/ellipsoid_view.hpp"
#include "view/slab_batches.hpp"

namespace sheetsplat {

namespace {

class GlPainter : public Painter {
  public:
    explicit GlPainter(std::optional<int> device) : device_(device) {}

    void open() override {
        if (!renderer_) {
            renderer_ = std::make_unique<backend_gl::GlRenderer>(device_);
        }
    }
    [[nodiscard]] const Capabilities* capabilities() const override {
        return renderer_ ? &renderer_->capabilities() : nullptr;
    }
    void measure() override {
        // Software is slower than the processor that it runs on.
        const Capabilities& capabilities = renderer_->capabilities();
        if (!capabilities.rates.known && !capabilities.software && capabilities.compute_memory > 0) {
            renderer_->set_rates(measured_rates(capabilities, device_));
        }
    }
    void draw(const Request& request, const Prepared& prepared, const Indexed& indexed, Image& image,
              std::vector<float>& doubts) override {
        const auto viewing = Clock::now();
        const backend_gl::Setup setup = backend_gl::set_up(prepared.plan, request.scene, renderer_->capabilities());
        const DrawPlan& plan = setup.plan;
        backend_gl::Job job;
        job.layout = setup.layout;
        std::size_t drawn = 0, bytes = 0;
        std::vector<SlabBatches> batches;
        batches.reserve(indexed.runs.size());
        for (std::size_t part = 0; part < indexed.runs.size(); ++part) {
            const RunsEntry& entry = *indexed.runs[part];
            job.regular.push_back(
                {prepared.view_fields[part], &prepared.views[part], nullptr, &entry.runs, entry.version});
            if (plan.compute) {
                drawn += entry.runs.samples();
                continue;
            }
            batches.push_back(SlabBatches::of(prepared.views[part], entry.runs, prepared.frame, request.scene.sampling,
                                              job.layout, plan.fine_along ? 1 : 0));
            drawn += batches.back().kernels();
            bytes += batches.back().bytes();
            job.regular.back().batches = &batches.back();
        }
        const int wider = plan.fine_gradient ? 1 : 0;
        const bool may_narrow = plan.packing == Packing::wide && !plan.fine_gradient;
        const std::vector<EllipsoidView> views =
            views_of(indexed, plan, request.camera, prepared.frame, request.scene.sampling);
        std::vector<CellTraversal> traversals;
        traversals.reserve(views.size());
        for (std::size_t part = 0; part < views.size(); ++part) {
            const GridEntry& entry = *indexed.grids[part];
            job.ellipsoids.push_back({prepared.ellipsoid_fields[part], entry.kernels, &views[part], nullptr,
                                      &entry.grid, &entry.visible, entry.version});
            if (plan.compute) {
                drawn += entry.visible_count;
                continue;
            }
            traversals.push_back(CellTraversal::of(views[part], entry.grid, entry.starts.get(), entry.visible,
                                                   job.layout, wider, wider, may_narrow, setup.largest_sprite,
                                                   plan.precise_aspect));
            drawn += traversals.back().kernels();
            bytes += traversals.back().bytes();
            job.ellipsoids.back().traversal = &traversals.back();
        }
        image.stats["seconds_view"] = seconds_since(viewing);

        job.scene = &request.scene;
        job.camera = &request.camera;
        job.frame = &prepared.frame;
        job.plan = &plan;
        job.tile_size = request.options.tile_size;
        job.tags_per_clear = request.options.tags_per_clear;
        job.volumes = &indexed.volumes;
        job.progress = &request.progress;
        job.doubts = &doubts;
        renderer_->render(job, image);
        image.stats["kernels_drawn"] = static_cast<double>(drawn);
        image.stats["bytes_view"] = static_cast<double>(bytes);
    }

  private:
    std::optional<int> device_;
    std::unique_ptr<backend_gl::GlRenderer> renderer_;
};

} // namespace

std::unique_ptr<Painter> make_gl_painter(const Devices& devices) { return std::make_unique<GlPainter>(devices.number); }
std::vector<DeviceReport> survey_gl() { return backend_gl::survey(); }

} // namespace sheetsplat
