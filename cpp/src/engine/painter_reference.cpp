// Backend reference as the engine asks for it: it draws the caller's scene.
#include "painters.hpp"

#include <algorithm>

#include "base/clock.hpp"
#include "reference/reference.hpp"

namespace sheetsplat {

namespace {

class ReferencePainter : public Painter {
  public:
    void draw(const Request& request, const Prepared&, const Indexed&, Image& image, std::vector<float>&) override {
        const auto drawing = Clock::now();
        reference::Request asked;
        asked.coverage = request.outputs.coverage;
        asked.depth = request.outputs.depth;
        asked.progress = request.progress;
        const reference::Picture picture = reference::render(request.scene, request.camera, request.size, asked);
        const auto to_float = [](const std::vector<double>& from) {
            std::vector<float> to(from.size());
            std::transform(from.begin(), from.end(), to.begin(),
                           [](double value) { return static_cast<float>(value); });
            return to;
        };
        image.rgba = to_float(picture.rgba);
        image.scalar = to_float(picture.scalar);
        image.coverage = to_float(picture.coverage);
        image.depth = to_float(picture.depth);
        if (request.scene.part) {
            image.counts = to_float(picture.counts);
        }
        image.stats["kernels_drawn"] = static_cast<double>(picture.kernels_drawn);
        image.stats["seconds_draw"] = seconds_since(drawing);
    }
};

} // namespace

std::unique_ptr<Painter> make_reference_painter(const Devices&) { return std::make_unique<ReferencePainter>(); }

std::vector<DeviceReport> survey_reference() {
    DeviceReport report;
    report.backend = traits_of(Backend::reference).name;
    report.available = true;
    report.description = "float64 on one thread: defines the picture";
    return {report};
}

} // namespace sheetsplat
