// The least time of splatting: the inner loops alone, over prepared kernels, into sheets that stay in the cache. No
// views, tiles, sorting, clipping, normalisation or shading. `./run bench cpu` compares the renderer with it.
//
//     sheetsplat_bare_loop spheres|ellipsoids PIXELS
//
// PIXELS: mean area of a section. Prints a JSON list: sections a second on one core, sections drawn, seconds.
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <string>
#include <vector>

#include "hwy/highway.h"
#include "math-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

constexpr int edge = 64, stride = 96, slices = 4, ring = 8;
constexpr float falloff_log2 = 8.0F * 1.4426950408889634F;

struct Kernel {
    float x, y, s; ///< centre, pixels; height on its first slice
    float value;
    int slice;
};

using D = hn::CappedTag<float, 16>;

/// One Gaussian along each axis for four sections; rows as wide as the kernel is.
std::uint64_t spheres(const std::vector<Kernel>& kernels, float radius, float* sheets) {
    const D d;
    const int lanes = static_cast<int>(hn::Lanes(d));
    const auto lowered = hn::Set(d, std::exp(-8.0F));
    const auto scale = hn::Set(d, -falloff_log2);
    HWY_ALIGN float bell_x[stride], bell_y[stride], bell_z[16];
    const auto bells = [&](float at, float step, int count, float* out) {
        for (int i = 0; i < count; i += lanes) {
            const auto place = hn::MulAdd(hn::Set(d, step), hn::Iota(d, static_cast<float>(i)), hn::Set(d, at));
            hn::StoreU(exp2_nonpositive(d, hn::Mul(scale, hn::Mul(place, place))), d, out + i);
        }
    };
    const float step = 1.0F / radius;
    for (const Kernel& kernel : kernels) {
        const int x0 = static_cast<int>(kernel.x - radius), x1 = static_cast<int>(kernel.x + radius) + 1;
        const int y0 = static_cast<int>(kernel.y - radius), y1 = static_cast<int>(kernel.y + radius) + 1;
        bells((static_cast<float>(x0) - kernel.x) * step, step, x1 - x0, bell_x);
        bells((static_cast<float>(y0) - kernel.y) * step, step, y1 - y0, bell_y);
        bells(kernel.s, -2.0F / slices, slices, bell_z);
        const auto value = hn::Set(d, kernel.value);
        for (int slice = 0; slice < slices; ++slice) {
            float* sheet = sheets + ((kernel.slice + slice) % ring) * edge * stride;
            for (int y = y0; y < y1; ++y) {
                const auto factor = hn::Set(d, bell_y[y - y0] * bell_z[slice]);
                for (int x = x0; x < x1; x += lanes) {
                    float* at = sheet + y * stride + x;
                    const auto bell = hn::MulSub(hn::LoadU(d, bell_x + (x - x0)), factor, lowered);
                    hn::StoreU(hn::MulAdd(value, hn::Max(bell, hn::Zero(d)), hn::LoadU(d, at)), d, at);
                }
            }
        }
    }
    return kernels.size() * slices;
}

/// Ellipses of 1:2 that lean, rows of one width whose centres move; one exponential a vector.
std::uint64_t ellipsoids(const std::vector<Kernel>& kernels, float radius, float* sheets) {
    const D d;
    const int lanes = static_cast<int>(hn::Lanes(d));
    const auto lowered = hn::Set(d, std::exp(-8.0F));
    const auto scale = hn::Set(d, -falloff_log2);
    for (const Kernel& kernel : kernels) {
        const auto value = hn::Set(d, kernel.value);
        for (int slice = 0; slice < slices; ++slice) {
            float* sheet = sheets + ((kernel.slice + slice) % ring) * edge * stride;
            const float s = kernel.s - static_cast<float>(slice) * 2.0F / slices;
            const float rest = 1.0F - s * s;
            const float height = radius * 1.41421356F, width = radius * 0.70710678F;
            const float half_rows = height * std::sqrt(rest);
            const int y0 = static_cast<int>(std::ceil(kernel.y - half_rows));
            const int y1 = static_cast<int>(std::floor(kernel.y + half_rows)) + 1;
            for (int y = y0; y < y1; ++y) {
                const float dy = static_cast<float>(y) - kernel.y, v = dy / height;
                const float inside = std::sqrt(std::max(rest - v * v, 0.0F)) * width;
                const float centre = kernel.x + 0.3F * dy;
                const int x0 = static_cast<int>(std::ceil(centre - inside)), x1 = static_cast<int>(centre + inside) + 1;
                for (int x = x0; x < x1; x += lanes) {
                    const auto u = hn::Mul(hn::Sub(hn::Iota(d, static_cast<float>(x)), hn::Set(d, centre)),
                                           hn::Set(d, 1.0F / width));
                    const auto r2 = hn::MulAdd(u, u, hn::Set(d, v * v + s * s));
                    const auto bell = hn::Sub(exp2_nonpositive(d, hn::Mul(scale, r2)), lowered);
                    float* at = sheet + y * stride + x;
                    hn::StoreU(hn::MulAdd(value, hn::Max(bell, hn::Zero(d)), hn::LoadU(d, at)), d, at);
                }
            }
        }
    }
    return kernels.size() * slices;
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

namespace {

namespace vectors = sheetsplat::backend_cpu::HWY_NAMESPACE;

double now() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

} // namespace

int main(int argc, char** argv) {
    const std::string kind = argc == 3 ? argv[1] : "";
    const double pixels = argc == 3 ? std::atof(argv[2]) : 0.0;
    // The mean section of a sphere has two thirds of its largest one's area.
    const double radius = std::sqrt(1.5 * pixels / 3.14159265358979);
    if ((kind != "spheres" && kind != "ellipsoids") || !(radius > 0.5)) {
        std::fprintf(stderr, "usage: %s spheres|ellipsoids PIXELS (at least 1)\n", argv[0]);
        return 2;
    }
    // Larger ones than a sheet holds would be cut into tiles: each is as large as fits, and counts as many times.
    const double most = kind == "spheres" ? 0.45 * vectors::edge : 0.3 * vectors::edge;
    const double fits = std::min(radius, most), shares = radius * radius / (fits * fits);
    std::mt19937 random(2005);
    std::uniform_real_distribution<double> uniform(0.0, 1.0);
    std::vector<vectors::Kernel> kernels(20000);
    const double margin = 1.42 * fits + 1.0;
    for (vectors::Kernel& kernel : kernels) {
        const auto place = [&](double reach) {
            const double room = std::max(vectors::edge - 2.0 * reach, 0.0);
            return static_cast<float>(0.5 * (vectors::edge - room) + room * uniform(random));
        };
        kernel = {place(fits + 1.0), place(kind == "spheres" ? fits + 1.0 : margin),
                  static_cast<float>(1.0 - 2.0 / vectors::slices * uniform(random)), 0.5F,
                  static_cast<int>(uniform(random) * vectors::ring)};
    }
    std::vector<float> sheets(static_cast<std::size_t>(vectors::ring * vectors::edge * vectors::stride + 64), 0.0F);
    double best = 1e300;
    std::uint64_t sections = 0;
    const double began = now();
    for (int round = 0; round < 200 && (round < 3 || now() - began < 2.0); ++round) {
        const double start = now();
        const auto r = static_cast<float>(fits);
        sections = kind == "spheres" ? vectors::spheres(kernels, r, sheets.data())
                                     : vectors::ellipsoids(kernels, r, sheets.data());
        best = std::min(best, now() - start);
    }
    double sum = 0.0;
    for (const float value : sheets) {
        sum += static_cast<double>(value);
    }
    if (!(sum > 0.0)) {
        std::fprintf(stderr, "nothing was drawn\n");
        return 1;
    }
    std::printf("[%.6g, %llu, %.6g]\n", static_cast<double>(sections) / best / shares,
                static_cast<unsigned long long>(sections), best);
    return 0;
}
