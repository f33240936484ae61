// What only the plans of backend reference say: it has one way of drawing.
#include "parts.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {

void plan_reference(const PlanInputs& inputs, Effects& effects, DrawPlan& plan) {
    const RendererOptions& options = inputs.options;
    const Scene& scene = inputs.scene;
    RenderPlan& summary = plan.summary;
    plan.precision = Precision::float64;
    if (options.precision != Precision::automatic && options.precision != Precision::float64) {
        throw Unsupported(
            Complaint{"the plan cannot be made",
                      std::string("precision ") + to_string(options.precision) + " with backend reference",
                      "float64 or auto", "", "precision"});
    }
    summary.precision = plan.precision;
    summary.packing = Packing::wide;
    summary.tagging = Tagging::off;
    summary.device = "float64, one thread";
    effects.state(EffectId::separate_normalization, scene.fields.size() > 1 && plan.threshold,
                  "each field is divided before all are added", "at most one division is needed for the whole scene");
    effects.state(EffectId::culling, false, "the reference looks at every kernel");
    effects.state(EffectId::elimination, false, "the reference sums every slice of every pixel");
    effects.state(EffectId::opacity_buffer, false, "the reference looks at every kernel");
    effects.state(EffectId::tagging, false, "the reference looks at every pixel of every slice");
    effects.state(EffectId::sums, true, "kernels are summed in float64");
}

} // namespace sheetsplat
