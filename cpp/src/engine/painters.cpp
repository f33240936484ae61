#include "painters.hpp"

#include <array>

namespace sheetsplat {

namespace {

struct Registered {
    std::unique_ptr<Painter> (*make)(const Devices&);
    std::vector<DeviceReport> (*survey)();
};

#define SHEETSPLAT_REGISTERED(name, ...) Registered{&make_##name##_painter, &survey_##name},
constexpr std::array painters{SHEETSPLAT_BACKENDS(SHEETSPLAT_REGISTERED)};
#undef SHEETSPLAT_REGISTERED

} // namespace

std::unique_ptr<Painter> make_painter(Backend backend, const Devices& devices) {
    return painters[index_of(backend)].make(devices);
}

std::vector<DeviceReport> devices() {
    std::vector<DeviceReport> reports;
    // Those that need no device first.
    for (auto painter = painters.rbegin(); painter != painters.rend(); ++painter) {
        const std::vector<DeviceReport> own = painter->survey();
        reports.insert(reports.end(), own.begin(), own.end());
    }
    return reports;
}

} // namespace sheetsplat
