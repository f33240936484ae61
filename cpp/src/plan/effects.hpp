// What the plans of all backends share: effects with their reasons, and what sums of kernels come to.
#pragma once

#include <cstdint>
#include <limits>
#include <map>
#include <string>
#include <vector>

#include "plan/make_plan.hpp"

namespace sheetsplat {

/// A number for a sentence: four digits.
std::string number(double value);
/// "1 kernel", "2 kernels".
std::string kernels(std::size_t count);

/// Collects effects with their reasons, and what the caller forced.
class Effects {
  public:
    /// Throws InvalidInput for names that no backend knows.
    Effects(const std::map<std::string, bool>& forced, std::vector<Effect>& list);

    /// An effect that follows from the scene. `needed`: turning it off would make a wrong picture.
    bool decide(const char* name, bool on, const std::string& reason, bool needed = false);
    void state(const char* name, bool on, const std::string& reason) { list_.push_back({name, on, reason, false}); }
    /// Throws Unsupported where effects were forced off that the scene needs.
    void refuse_dropped() const;

  private:
    const std::map<std::string, bool>& forced_;
    std::vector<Effect>& list_;
    std::vector<std::string> dropped_;
};

/// What the sums of a scene come to, against what its picture resolves.
struct SumFacts {
    double overlap = 0.0;     ///< kernels at a point
    double largest = 0.0;     ///< bound on |rho|
    double resolved = 1.0;    ///< the transfer function's window; for an isosurface the spread of the values
    double ratio = 1.0;       ///< of the former two
    double sum = 0.0;         ///< bound on sums of weights, and of weighted values in the sheets' unit
    double steepness = 1.0;   ///< of opacity and colours over the window, a slice
    double least_scale = 0.0; ///< of fields that are divided: the larger of w0 and the smallest weight above 0
};
SumFacts sum_facts(const Scene& scene, const ViewFacts& view, const DrawPlan& plan);

/// Several fields of which one is divided by its weight sum: each of these gets its own sheets.
void divide_apart(const Scene& scene, const Outputs& outputs, Effects& effects, DrawPlan& plan);

/// True where quotients of sums are lit.
bool lights_quotients(const DrawPlan& plan);

/// Weights of 0 leave 1e-30 in the sheets, which tells what they reach from what is empty: what sums are divided by
/// must not be near.
constexpr double least_divisor = 1e-22;
/// Below this share of the reference length a pixel or a slice spacing loses gradients in differences of float32 sums.
constexpr double fine_gradient_below = 1.0 / 8.0;
/// Values over window, where quotients of sums are lit: at 30 the 99.9th percentile was seen at 7e-4, at 100 at 2e-3.
constexpr double largest_lit_ratio = 40.0;
/// exp(-k r^2) - exp(-k) is known to 1e-7 / k of itself.
constexpr double smallest_falloff = 0.05;
/// Plain float32 sums over 28,000 slices were seen 2e-6 off, over 280,000 4e-5, over 1,750,000 6e-4.
constexpr std::int64_t most_plain_slices = 1 << 14;
constexpr double float32_epsilon = 6e-8;
/// IMAGE FORMATION section 9.
constexpr double float32_bound = 1e-4;
/// Kernels larger than this cannot be placed, pixels.
constexpr double largest_splat_px = 1e12;

/// The processor's part of make_plan: `plan` holds what follows from the scene already. Throws Unsupported.
void plan_cpu(const Scene& scene, const ViewFacts& view, const RendererOptions& options, const Outputs& outputs,
              Effects& effects, DrawPlan& plan);

} // namespace sheetsplat
