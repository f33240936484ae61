// Pilots: coarse pictures of a view, or small parts of it, from which errors and times of settings are estimated.
#pragma once

#include <map>
#include <optional>

#include "probe.hpp"
#include "renderer_state.hpp"
#include "settings_search.hpp"

namespace sheetsplat {

/// Draws pilots with a renderer's state, which must outlive it, as must the request.
class Renderer::State::Pilots : public Judge {
  public:
    /// What pilots show of a large picture where a backend draws tiles alone: others for the search and for a check. By
    /// the other backends, and of small pictures, they show all.
    enum class Part { whole, searched, checked };

    /// larger: width of a pilot's pixels, in pixels of the picture, where it shows all of it. start: the settings that
    /// others are compared with.
    Pilots(State& state, const Request& request, const Settings& start, int larger, Part part);

    std::optional<double> error(const Settings& settings) override;
    double stop_error(const Settings& settings) override;
    double seconds(const Settings& settings) override;
    Floor floor() override;

    /// The error expected of light looked up in volumes, which pilots share with what they are compared with.
    double of_model(const Settings& settings);
    /// Root mean square difference between the renderer's precision and float64; 0 where float64 is not available.
    double arithmetic();
    /// Times pilots, where no picture was timed yet.
    void find_pace();
    [[nodiscard]] double pace() const { return pace_; }
    [[nodiscard]] Backend backend() const { return backend_; }
    /// Whether pilots have the pixels of the picture, so that gradients are its own.
    [[nodiscard]] bool of_excerpts() const { return excerpt_.has_value(); }

  private:
    [[nodiscard]] const Excerpt* excerpt() const { return excerpt_ ? &*excerpt_ : nullptr; }
    /// The backend would take minutes; the exact one gives the same estimate.
    [[nodiscard]] bool slow() const { return can(backend_, Ability::defines); }
    /// exact: in float64.
    Image draw(const Settings& settings, bool exact);
    /// The picture that pilots of a slice spacing are compared with.
    const Image& converged_for(double spacing);
    /// A picture of slices so close, without a stop, of which the last few are kept.
    const Image& fine(double spacing);
    [[nodiscard]] Request whole(const Scene& scene, const Progress& progress) const {
        return {scene, request_.camera, request_.size, no_outputs_, progress, request_.options};
    }

    State& state_;
    const Request& request_;
    Settings start_;
    Size size_;
    Camera camera_;
    Scene scene_; ///< as that camera sees it
    std::optional<Excerpt> excerpt_;
    Progress watch_;
    Outputs no_outputs_;
    Frame widest_;
    Work work_;
    Backend backend_ = Backend::cpu;
    Projection projection_ = Projection::orthographic;
    Precision precision_ = Precision::float32;
    double pace_ = 1.0;
    std::optional<Image> reference_;
    double reference_spacing_ = 1.0;
    Approach approach_;            ///< of pictures of closer and closer slices up to it
    double reference_error_ = 0.0; ///< by that
    std::map<double, Image> fine_; ///< by their slice spacing
    std::map<double, double> of_model_; ///< by slice spacing
    std::optional<double> measured_over_estimated_{};
};

} // namespace sheetsplat
