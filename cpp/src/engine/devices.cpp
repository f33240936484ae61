#include "sheetsplat/device.hpp"

#include "backend_choice.hpp"
#include "backend_gl/gl_renderer.hpp"
#include "base/instruction_set.hpp"

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
    processor.description = describe_cpu(thread_count(0));
    processor.extensions = instruction_sets();
    reports.push_back(processor);
    for (DeviceReport& report : backend_gl::survey()) {
        reports.push_back(std::move(report));
    }
    return reports;
}

} // namespace sheetsplat
