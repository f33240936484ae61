#include "regular_options.hpp"

#include <cmath>
#include <string>

#include <glm/geometric.hpp>
#include <glm/matrix.hpp>

#include "base/checks.hpp"
#include "base/unusable.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {
namespace {

constexpr const char* owner = "RegularField";
/// Sines below which axes count as coplanar.
constexpr double coplanar = 1e-9;

void require_positive(double value, const char* name) {
    if (!(value > 0.0) || !is_finite(value)) {
        throw InvalidInput(Complaint{unusable(owner, name), text_of(value), "a finite number above 0"});
    }
}

} // namespace

void check_options(const RegularFieldOptions& options) {
    const bool bcc = options.lattice == Lattice::bcc;
    const bool positive = options.spacing.x > 0.0 && (bcc || (options.spacing.y > 0.0 && options.spacing.z > 0.0));
    if (!options.axes && (!positive || !is_finite(options.spacing.x) || (!bcc && !is_finite(options.spacing)))) {
        throw InvalidInput(Complaint{unusable(owner, "spacing"), text_of(options.spacing),
                                     bcc ? "a finite first number above 0, the edge of the BCC lattice's cubes"
                                         : "three finite numbers above 0",
                                     "give the distance of neighbouring samples along x, y and z in world units"});
    }
    if (options.axes) {
        const Mat3& axes = *options.axes;
        const Vec3 lengths(glm::length(axes[0]), glm::length(axes[1]), glm::length(axes[2]));
        const std::string found =
            text_of(axes[0]) + ", " + text_of(axes[1]) + ", " + text_of(axes[2]) + (bcc ? " of a BCC lattice" : "");
        const bool usable = !bcc && is_finite(lengths) && lengths.x > 0.0 && lengths.y > 0.0 && lengths.z > 0.0;
        if (!usable || !(std::abs(glm::determinant(
                             Mat3(axes[0] / lengths.x, axes[1] / lengths.y, axes[2] / lengths.z))) > coplanar)) {
            throw InvalidInput(Complaint{unusable(owner, "axes"), found,
                                         "three finite steps that are not coplanar, of a Cartesian lattice",
                                         "give the steps of i, j and k in the world as rows"});
        }
    }
    if (!is_finite(options.origin)) {
        throw InvalidInput(Complaint{unusable(owner, "origin"), text_of(options.origin), "three finite numbers",
                                     "give the world position of sample (0, 0, 0)"});
    }
    require_positive(options.radius, "radius");
    require_positive(options.falloff, "falloff");
    if (options.normalization == Normalization::threshold) {
        require_positive(options.w0, "w0");
    } else if (!is_finite(options.w0)) {
        throw InvalidInput(Complaint{unusable(owner, "w0"), text_of(options.w0), "a finite number"});
    }
    if (options.base && !(std::abs(*options.base) <= largest_sample)) {
        throw InvalidInput(Complaint{unusable(owner, "base"), text_of(*options.base),
                                     "a finite number of magnitude up to " + text_of(largest_sample),
                                     "leave it out to count values from one of the data's"});
    }
}

} // namespace sheetsplat
