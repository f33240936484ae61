// How long pictures took, against what was expected of them.
#pragma once

#include <array>

#include "sheetsplat/render_plan.hpp"

namespace sheetsplat {

/// Times of pictures over expected_seconds, for each backend: of whole pictures, and of coarse ones.
class Paces {
  public:
    void note(Backend backend, bool coarse, double pace);
    /// As last seen; a guess until one was timed.
    [[nodiscard]] double last(Backend backend, bool coarse) const { return at(backend, coarse).last; }
    /// The least of the last three of pictures, or where none was drawn yet of coarse ones.
    [[nodiscard]] double best(Backend backend) const;
    [[nodiscard]] bool knows_pictures(Backend backend) const { return at(backend, false).timed; }

  private:
    struct Pace {
        double last = 1.0;
        bool timed = false;
        std::array<double, 3> recent{};
    };
    [[nodiscard]] const Pace& at(Backend backend, bool coarse) const {
        return paces_[static_cast<std::size_t>(backend)][coarse ? 1 : 0];
    }
    /// In the order of Backend.
    std::array<std::array<Pace, 2>, 4> paces_{
        {{{{1.0}, {1.0}}}, {{{4.0}, {4.0}}}, {{{1.0}, {1.0}}}, {{{200.0}, {200.0}}}}};
};

} // namespace sheetsplat
