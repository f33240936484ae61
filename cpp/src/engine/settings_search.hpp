// Searches settings for a requested error or time: the fastest that keep the error, or the most accurate within the
// time.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "sheetsplat/error.hpp"
#include "sheetsplat/image.hpp"

namespace sheetsplat {

/// The settings that may be changed; the others stay as the caller set them.
struct Freedom {
    bool spacing = true;
    bool sampling = true; ///< from point to slab
    bool preintegration = true;
    bool stop = true;
};

struct Goal {
    std::optional<double> error;   ///< root mean square
    std::optional<double> seconds; ///< of one picture
    /// Share of the requested error that is aimed at, because errors are estimates.
    double aimed_share = 0.85;
};

/// Errors and times of settings, as far as they can be known before the picture is drawn.
class Judge {
  public:
    Judge() = default;
    Judge(const Judge&) = delete;
    Judge& operator=(const Judge&) = delete;
    virtual ~Judge() = default;
    /// Distance from the converged picture; nothing where the scene cannot be drawn with these settings.
    virtual std::optional<double> error(const Settings& settings) = 0;
    /// The part of it that the stop causes.
    virtual double stop_error(const Settings& settings) = 0;
    virtual double seconds(const Settings& settings) = 0;
    /// An error below which no settings are known to get, and its cause.
    struct Floor {
        double error = 0.0;
        std::string cause;
        Words advice;
    };
    virtual Floor floor() { return {}; }
};

struct Choice {
    Settings settings;
    double error = 0.0;   ///< expected
    double seconds = 0.0; ///< expected
    bool error_kept = true;
    bool seconds_kept = true;
    std::vector<std::string> looked_at; ///< kinds of settings that were compared, in words
};

/// Slice distances between which is chosen, in those of `start`.
constexpr double coarsest_spacing = 4.0;
constexpr double finest_spacing = 1.0 / 256.0;

/// start: the scene's settings, with the default slice distance unless the scene gives one. Throws InvalidInput where
/// an error is asked for that what is fixed does not allow, Unsupported where it is out of reach of everything that was
/// tried.
Choice choose_settings(const Settings& start, const Freedom& freedom, const Goal& goal, Judge& judge);

/// "point sampling", "second-order pre-integration" and the like.
std::string kind_of(const Settings& settings);

} // namespace sheetsplat
