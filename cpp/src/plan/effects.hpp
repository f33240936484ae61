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
    /// Backend reference forces nothing: it draws what the scene says. Throws InvalidInput for names that no backend
    /// knows, and for those that follow from something else.
    Effects(const std::map<std::string, bool>& forced, Backend backend, std::vector<Effect>& list);

    /// An effect that follows from the scene. `needed`: turning it off would make a wrong picture.
    bool decide(const char* name, bool on, const std::string& reason, bool needed = false);
    /// The same where the scene must bring numbers of its own, as a clip its planes: without them (`given` is false)
    /// there is nothing to turn on.
    bool decide_given(const char* name, bool given, bool on, const std::string& reason);
    void state(const char* name, bool on, const std::string& reason) { list_.push_back({name, on, reason, false}); }
    /// Throws Unsupported where effects were forced off that the scene needs.
    void refuse_dropped() const;

  private:
    std::map<std::string, bool> forced_;
    std::vector<Effect>& list_;
    std::vector<std::string> dropped_;
};

/// What the sums of a scene come to, against what its picture resolves.
struct SumFacts {
    double overlap = 0.0;      ///< kernels at a point
    double largest = 0.0;      ///< bound on |rho|
    double resolved = 1.0;     ///< the transfer function's window; for an isosurface the spread of the values
    double ratio = 1.0;        ///< of the former two
    double sum = 0.0;          ///< bound on sums of weights, and of weighted values in the sheets' unit
    double steepness = 1.0;    ///< of opacity and colours over the window, a slice
    double least_scale = 0.0;  ///< of fields that are divided: the larger of w0 and the smallest weight above 0
    double weight_range = 0.0; ///< of fields that are divided: largest m / w0
    double crowd = 1.0; ///< kernels at a point where they are densest: exact for lattices, else twice an estimate
    double bend = 1.0;  ///< root mean square of colours' and opacity's slopes over the values that occur, at least 1
};
SumFacts sum_facts(const Scene& scene, const ViewFacts& view, const DrawPlan& plan);

/// Whether an interval that is empty must be told from one whose ends are 0: where clipping leaves one end of an
/// interval, which shows only if a kernel reaches it, and where the cubic of second order is not 0 between two ends
/// that are.
bool intervals_may_be_empty(const Scene& scene, const SumFacts& sums, const DrawPlan& plan);

/// Several fields of which one is divided by its weight sum: each of these gets its own sheets. always: a single one
/// does too.
void divide_apart(const Scene& scene, const Outputs& outputs, Effects& effects, DrawPlan& plan, bool always = false);

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
constexpr double float64_epsilon = 1.2e-16;
/// IMAGE FORMATION section 9.
constexpr double float32_bound = 1e-4;
/// Kernels larger than this cannot be placed, pixels.
constexpr double largest_splat_px = 1e12;

/// What the shared part of make_plan found that a way of drawing depends on.
struct SceneCalls {
    bool lattices = false; ///< some field is drawn as a lattice
    bool spheres = false;  ///< some field is drawn as spheres of its own
    bool stops = false;    ///< pixels can become opaque enough to stop
    double opacity = 1.0;  ///< largest that occurs
};

/// True where opacity can reach A_stop along some ray of this many slices of at most `opacity` each.
bool saturates_within(const Scene& scene, const ViewFacts& view, std::int64_t slices, double opacity);

/// Root mean square rounding of the sum of so many kernels, over its size. `truncates`: stores in 16 bits cut off.
double sum_noise(Precision precision, bool truncates, double crowd);

/// The shares of sums, of the gradients made of them, and of the picture. noise: of sum_noise.
void expect_errors(const ViewFacts& view, const SumFacts& sums, double noise, DrawPlan& plan);

/// The amount of rho that sheets call 1.
double unit_of_values(const Scene& scene, const ViewFacts& view);

/// The shares of light that is left, looked up in volumes. What their numbers differ by from sums along each ray grows
/// with what a step takes away. opacity: largest that occurs.
void expect_light_errors(const Scene& scene, const ViewFacts& view, double opacity, DrawPlan& plan);

/// Puts on each effect what it owes of the error budget. Every share names an effect of the list.
void charge_effects(RenderPlan& plan);

/// OpenGL's part of make_plan: `plan` holds what follows from the scene already. Throws Unsupported.
void plan_gl(const Scene& scene, const ViewFacts& view, const RendererOptions& options, const Outputs& outputs,
             const Capabilities& capabilities, const SceneCalls& calls, Effects& effects, DrawPlan& plan);

/// The processor's part of make_plan: `plan` holds what follows from the scene already. Throws Unsupported.
void plan_cpu(const Scene& scene, const ViewFacts& view, const RendererOptions& options, const Outputs& outputs,
              Effects& effects, DrawPlan& plan);

} // namespace sheetsplat
