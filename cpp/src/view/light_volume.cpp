#include "view/light_volume.hpp"

#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>

namespace sheetsplat {

double LightVolume::at(const Vec3& world) const {
    int whole[3];
    double part[3];
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const double last = static_cast<double>(counts[axis] - 1);
        const double place = std::clamp(glm::dot(world - origin, per_step[axis]), 0.0, last);
        whole[axis] = std::min(static_cast<int>(place), std::max(counts[axis] - 2, 0));
        part[axis] = place - whole[axis];
    }
    double sum = 0.0;
    for (int corner = 0; corner < 8; ++corner) {
        double share = 1.0;
        int at[3];
        for (int axis = 0; axis < 3; ++axis) {
            const bool further = ((corner >> axis) & 1) != 0;
            share *= further ? part[axis] : 1.0 - part[axis];
            at[axis] = std::min(whole[axis] + (further ? 1 : 0), counts[static_cast<std::size_t>(axis)] - 1);
        }
        sum += share * static_cast<double>(values[index(at[0], at[1], at[2])]);
    }
    return sum;
}

} // namespace sheetsplat
