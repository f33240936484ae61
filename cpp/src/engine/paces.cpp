#include "paces.hpp"

#include <algorithm>

namespace sheetsplat {

void Paces::note(Backend backend, bool coarse, double pace) {
    Pace& known = paces_[static_cast<std::size_t>(backend)][coarse ? 1 : 0];
    if (!known.timed) {
        known.recent.fill(pace);
    }
    known.recent = {known.recent[1], known.recent[2], pace};
    known.last = pace;
    known.timed = true;
}

double Paces::best(Backend backend) const {
    const Pace& pictures = at(backend, false);
    const Pace& known = pictures.timed || !at(backend, true).timed ? pictures : at(backend, true);
    // Other work on the machine only ever makes pictures slower.
    return known.timed ? *std::min_element(known.recent.begin(), known.recent.end()) : known.last;
}

} // namespace sheetsplat
