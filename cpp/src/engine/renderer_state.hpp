// What a renderer keeps between pictures, and the way from a request to a picture, each step a function of those
// before: frame, facts, plan and views (prepare); what is drawn (find_drawn); the image.
#pragma once

#include <memory>

#include "backend_choice.hpp"
#include "counted_scene.hpp"
#include "draw.hpp"
#include "facts/field_survey.hpp"
#include "field_index.hpp"
#include "field_levels.hpp"
#include "light/light_error.hpp"
#include "light/volumes.hpp"
#include "settings_choice.hpp"
#include "sheetsplat/renderer.hpp"

namespace sheetsplat {

struct Renderer::State {
    explicit State(const RendererOptions& options);
    ~State();
    State(const State&) = delete;
    State& operator=(const State&) = delete;

    /// Throws what Renderer::plan throws.
    Prepared prepare(const Request& asked);
    /// The picture of a request. drawn_like: what decides which kernels are drawn, in place of the request's own frame:
    /// coarse stages draw what the picture that they lead to draws, without another look at all kernels.
    Image render(const Request& request, const Frame* drawn_like = nullptr);

    /// With the settings of max_error and max_seconds, where the options have them.
    RenderPlan plan_chosen(const Request& request);
    Image render_chosen(const Request& request);
    /// Null where the options ask for neither. Lives until the next call.
    const Chosen* choose(const Request& request);
    /// Puts measured errors of shadows and ambient occlusion in the place of the plan's estimates. A view near the last
    /// one of the same scene (30 degrees, 10 where a light that casts shadows turns with the camera) has that one's,
    /// and estimates stand where measuring would take longer than the picture; not so `anew`. Returns whether the plan
    /// has errors that were measured.
    bool measure_light(const Request& request, RenderPlan& plan, bool anew = false);
    ErrorEstimate estimate_error(const Image& image, const Scene& shown, const Camera& camera,
                                 const Progress& progress);

    LightPlan plan_light(const Request& request);
    std::vector<LightPiece> light_pieces(const Request& request, const LightPlan& light);
    std::vector<LightSpot> light_spots(const Request& request, const std::vector<std::size_t>& numbers);
    LightLines light_lines(const Request& request, const std::vector<LightSpot>& spots, std::size_t part);

    /// The scene with the fields of a level in the place of its own.
    Scene at_level(Scene scene, const Level& level, const Progress& progress);

    [[nodiscard]] const RendererOptions& options() const { return options_; }
    [[nodiscard]] const Paces& paces() const { return paces_; }

  private:
    class Pilots;
    [[nodiscard]] Reach reach() const;
    /// The fields of a scene, those that stand for them in coarser pictures, and their drawn forms.
    [[nodiscard]] std::vector<std::shared_ptr<const Field>> kept_fields(const Scene& asked);
    Indexed find_drawn(const Request& asked, const Prepared& prepared, const Frame& drawn_like);
    /// request: of the scene that is drawn.
    LightVolumes light_volumes(const Request& request, const Prepared& prepared, const Indexed& indexed, Image& image);
    void draw(const Request& asked, const Prepared& prepared, const Frame& drawn_like, Image& image);
    /// Draws tiles whose light shows rounding again, on the exact backend. doubts: a pixel each.
    void draw_doubtful(const Request& asked, const Prepared& prepared, const std::vector<float>& doubts, Image& image);

    const RendererOptions options_;
    BackendChoice backends_;
    FieldSurveys surveys_;
    FieldIndex index_;
    FieldLevels levels_;
    CountedFields counted_;
    LightVolumeCache light_;
    LightErrorProbe light_probe_;
    struct MeasuredLight {
        Chosen view;
        Backend backend;
        LightErrors errors;
    };
    std::unique_ptr<MeasuredLight> measured_;
    Paces paces_;
    std::unique_ptr<Chosen> chosen_;
};

} // namespace sheetsplat
