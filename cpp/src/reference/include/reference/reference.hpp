// The float64 reference renderer: one thread, as plain as conventions reads. Every faster path is measured by its
// distance from this one, so it shares no arithmetic with any of them.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "sheetsplat/camera.hpp"
#include "sheetsplat/scene.hpp"
#include "sheetsplat/types.hpp"

namespace sheetsplat::reference {

/// float64 throughout; the same shapes as sheetsplat::Image. Coverage is the sum over all fields. Depth is that of the
/// slice, the crossing or (with preintegration) the middle of the interval whose addition brings A to one half, the
/// middle no nearer than the first slice.
struct Picture {
    Size size{};
    std::vector<double> rgba;     ///< h * w * 4, premultiplied; empty in scalar modes
    std::vector<double> scalar;   ///< h * w in scalar modes; NaN where no slice counts (mode xray: 0)
    std::vector<double> coverage; ///< h * w when asked for
    std::vector<double> depth;    ///< h * w when asked for
    std::vector<double> counts;   ///< h * w in modes mip, minimum and average: slices that count
    std::int64_t first_slice = 0;
    std::int64_t slices = 0;
    std::size_t kernels_drawn =
        0; ///< kernels whose support meets an existing slice and the image (with its border of one pixel)
};

struct Request {
    bool coverage = false;
    bool depth = false;
    /// Moves the arithmetic a little, to find pixels whose value jumps (conventions, section 9): added to every rho,
    /// as a share of v_max - v_min, where it is classified or compared with the iso value (scalar modes do not jump:
    /// not there, and gradients do not know of it); factor on all semi-axes minus one (C of normalisation lattice
    /// follows, what the EWA filter adds does not); added to A_stop.
    double nudge_rho = 0.0;
    double nudge_radius = 0.0;
    double nudge_stop = 0.0;
    /// Called between slices with the share done, with shadows or ambient occlusion between rows of pixels; returning
    /// false throws Cancelled.
    std::function<bool(double)> progress{};
};

/// Fields of any kind, filter included. Throws InvalidInput (scene.validate(), size below 1 x 1, more than 10^7 slices,
/// sums beyond float64), OutOfMemory, Cancelled.
/// The only shortcut: kernels whose value is the base, or of weight 0, are left out where they cannot matter (see
/// ZeroKernels in sums.hpp).
Picture render(const Scene& scene, const Camera& camera, Size size, const Request& request = {});

/// One flag a pixel: 1 where the picture changes by more than 1e-3 under any of the nudges of section 9 (both signs);
/// where depth is asked for, also 1 where it moves by more than half a slice distance. Scalar modes do not jump: all 0.
std::vector<unsigned char> ambiguous_pixels(const Scene& scene, const Camera& camera, Size size,
                                            const Request& request = {});

/// A field's sums at a point: D, counted from the base, W and whether no kernel reaches it.
struct Sums {
    double d = 0.0, w = 0.0;
    bool empty = true;
};
/// Of all kernels one by one, mirrored ones included, for tests. No filter.
Sums sums_at(const Field& field, const Vec3& point_world);

} // namespace sheetsplat::reference
