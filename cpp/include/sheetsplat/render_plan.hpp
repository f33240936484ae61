// What will run for a scene, and why, before it runs.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "sheetsplat/backend_table.hpp"
#include "sheetsplat/types.hpp"

namespace sheetsplat {

enum class Precision { automatic, uint8, float16, float32, float64 };
enum class Packing { automatic, paper, wide };
/// How backend gl draws: passes of the rasteriser, or compute programs (OpenGL 4.3).
enum class Path { automatic, raster, compute };
enum class Tagging { automatic, depth_bounds, depth_equal, tiles, off };

/// Anything that a scene may or may not call for.
struct Effect {
    std::string name;
    bool on = false;
    std::string reason;  ///< one sentence: why it is on or off
    bool forced = false; ///< true where the caller decided
    double error = 0.0;  ///< root mean square error that it adds to the picture: its shares of the error budget
};

/// What is known of an effect, for lists and documentation.
struct EffectInfo {
    std::string name;
    std::string meaning;              ///< of being on, in a few words
    std::string decided_by;           ///< what it follows from; empty where some backend can force it
    std::vector<Backend> listed_by;   ///< backends whose plans list it
    std::vector<Backend> forcible_on; ///< backends on which RendererOptions::effects can force it
};
/// All effects, in a fixed order.
std::vector<EffectInfo> known_effects();

/// One place where a picture may differ from the reference.
struct ErrorShare {
    std::string cause;
    double rmse = 0.0;    ///< bound or estimate
    std::string effect{}; ///< that causes it
};

struct RenderPlan {
    Backend backend = Backend::reference;
    Precision precision = Precision::float64;
    Packing packing = Packing::wide;
    Tagging tagging = Tagging::off;
    Path path = Path::raster; ///< of backend gl
    Size size{};
    double slice_spacing = 0.0;   ///< world units
    std::int64_t first_slice = 0; ///< n of the first slice
    std::int64_t slices = 0;      ///< number of slices
    double first_depth = 0.0;     ///< of the first slice
    bool cut_by_near = false;     ///< slices that meet kernels are missing in front because of the near plane
    std::vector<Effect> effects;
    std::vector<ErrorShare> error_budget;
    std::uint64_t memory = 0; ///< bytes beside the fields, all stages at once
    std::string device;       ///< in words

    /// True where the effect exists and is on.
    [[nodiscard]] bool has(const std::string& effect) const;
    /// Of all causes together: they are independent, so their squares add up.
    [[nodiscard]] double expected_error() const;
};

const char* to_string(Backend value);
const char* to_string(Precision value);
const char* to_string(Packing value);
const char* to_string(Tagging value);
const char* to_string(Path value);

} // namespace sheetsplat
