// Several random numbers at once: the same ones with every compiler, each of which evaluates arguments in an order of
// its own.
#pragma once

#include <glm/gtc/quaternion.hpp>

#include "sheetsplat/types.hpp"

namespace sheetsplat::test {

/// draw: returns the next number.
template <class Draw>
Vec3 three(const Draw& draw) {
    const double z = draw(), y = draw(), x = draw();
    return {x, y, z};
}

/// A rotation, uniform where draw is normal.
template <class Draw>
glm::dquat rotation(const Draw& draw) {
    const double z = draw(), y = draw(), x = draw(), w = draw();
    return glm::normalize(glm::dquat(w, x, y, z));
}

} // namespace sheetsplat::test
