#include "sheetsplat/device.hpp"

#include "backend_cpu/cpu_renderer.hpp"
#include "backend_gl/gl_renderer.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {

std::vector<DeviceReport> devices() {
    std::vector<DeviceReport> reports;
    DeviceReport reference;
    reference.backend = "reference";
    reference.available = true;
    reference.description = "float64 on one thread: the judge of the others";
    reports.push_back(reference);
    DeviceReport processor;
    processor.backend = "cpu";
    processor.available = true;
    const int threads = backend_cpu::usable_threads();
    processor.description =
        backend_cpu::instruction_set() + ", " + std::to_string(threads) + (threads == 1 ? " thread" : " threads");
    processor.extensions = backend_cpu::instruction_sets();
    reports.push_back(processor);
    for (DeviceReport& report : backend_gl::survey()) {
        reports.push_back(std::move(report));
    }
    return reports;
}

Seconds fill_test(std::size_t kernels, double diameter_px, int width, int height, int targets, int repeats) {
    if (!(diameter_px >= 1.0) || width < 1 || height < 1 || targets < 1 || targets > 4 || repeats < 1) {
        throw InvalidInput(
            Complaint{"the fill test cannot be run", "a diameter, size or number of targets out of range",
                      "a diameter of at least 1 pixel, at least 1 x 1 pixels, 1 to 4 targets, at least 1 repeat",
                      "correct the arguments"});
    }
    backend_gl::GlRenderer renderer;
    return renderer.fill_test(kernels, diameter_px, width, height, targets, repeats);
}

} // namespace sheetsplat
