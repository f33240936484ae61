#include "sheetsplat/light_volume.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <new>

#include <glm/geometric.hpp>

#include "sheetsplat/error.hpp"

namespace sheetsplat {

Vec3 LightVolume::place_of(const Vec3& world) const {
    const Vec3 from = world - origin;
    return {glm::dot(from, per_step[0]), glm::dot(from, per_step[1]), glm::dot(from, per_step[2])};
}

LightVolume::Around LightVolume::around(const Vec3& elements) const {
    int whole[3];
    double part[3];
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const double last = static_cast<double>(counts[axis] - 1);
        const double place = std::clamp(elements[static_cast<int>(axis)], 0.0, last);
        whole[axis] = std::min(static_cast<int>(place), std::max(counts[axis] - 2, 0));
        part[axis] = place - whole[axis];
    }
    Around found{0.0, std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
    for (int corner = 0; corner < 8; ++corner) {
        double share = 1.0;
        int at[3];
        for (int axis = 0; axis < 3; ++axis) {
            const bool further = ((corner >> axis) & 1) != 0;
            share *= further ? part[axis] : 1.0 - part[axis];
            at[axis] = std::min(whole[axis] + (further ? 1 : 0), counts[static_cast<std::size_t>(axis)] - 1);
        }
        const auto value = static_cast<double>(values[index(at[0], at[1], at[2])]);
        found.number += share * value;
        found.least = std::min(found.least, value);
        found.greatest = std::max(found.greatest, value);
    }
    return found;
}

LightVolume laid_out(const LightGrid& grid, bool of_rho) {
    const double deep = grid.spacing * grid.every;
    LightVolume volume;
    volume.per_step = {Vec3(1.0 / grid.step, 0.0, 0.0), Vec3(0.0, -1.0 / grid.step, 0.0), Vec3(0.0, 0.0, -1.0 / deep)};
    // A plane lies in the middle of its slices.
    volume.origin = grid.first + Vec3(0.0, 0.0, 0.5 * (grid.every + 1) * grid.spacing);
    volume.counts = grid.counts(of_rho);
    try {
        volume.values.assign(volume.index(0, 0, volume.counts[2]), 0.0F);
    } catch (const std::bad_alloc&) {
        throw OutOfMemory(Complaint{"shadows or ambient occlusion cannot be drawn", "not enough memory",
                                    "memory for the opacity along rays to lights",
                                    "leave out " + option_ref("shadows") + " and " + option_ref("ambient_occlusion")});
    }
    return volume;
}

} // namespace sheetsplat
