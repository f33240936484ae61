#include "sheetsplat/device.hpp"

#include "sheet/sheet_renderer.hpp"

namespace sheetsplat {

std::vector<DeviceReport> devices() {
    std::vector<DeviceReport> reports;
    DeviceReport reference;
    reference.backend = "reference";
    reference.available = true;
    reference.description = "float64 on one thread: the judge of the others";
    reports.push_back(reference);
    for (DeviceReport& report : sheet::survey()) {
        reports.push_back(std::move(report));
    }
    return reports;
}

} // namespace sheetsplat
