// Volumes for shadows and ambient occlusion: absorption on a grid along the world's axes, and from it transmittance
// towards each light and the mean transmittance of each point's surroundings; in mode isosurface rho, in which surfaces
// are found. Made by the processor for all backends. Source: conventions, section 10.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "light/grids.hpp"
#include "light/march.hpp"
#include "sheetsplat/image.hpp"
#include "sheetsplat/light_volume.hpp"

namespace sheetsplat {

/// Light volumes of grids that others have filled: of each grid of the plan its volume. Throws OutOfMemory, Cancelled.
LightVolumes light_volumes_of(const LightPlan& light, std::vector<LightVolume> grids, int threads,
                              const Progress& progress);

/// Keeps volumes between pictures: those of world lights, of ambient occlusion and of rho serve every view of a
/// scene.
class LightVolumeCache {
  public:
    /// For a plan with shadows or ambient occlusion; volumes that it does not call for are left out. Adds to the stats
    /// seconds_light and bytes_light. Throws OutOfMemory, Cancelled.
    /// versions: of what is drawn.
    LightVolumes of(const LitView& view, std::vector<std::uint64_t> versions, const Reach& reach, const FillLight& fill,
                    Image& image);
    /// The grid of absorption of the last volumes of(); null where there is none, or no longer.
    [[nodiscard]] std::shared_ptr<const LightVolume> absorption() const { return absorption_.lock(); }

  private:
    /// What a volume was made from; the fields are kept so that no other one gets their address.
    struct Origin {
        std::vector<std::shared_ptr<const Field>> fields;
        std::vector<std::size_t> groups;     ///< of each its first field and how many of the points are its own
        std::vector<std::uint64_t> versions; ///< of what is drawn
        std::vector<TransferPoint> points;   ///< of all groups
        Clip clip;
        double slice_spacing = 0.0, reference_length = 0.0, value_unit = 1.0;
        bool filter = false;
        Precision precision = Precision::float32;

        [[nodiscard]] bool operator==(const Origin& other) const;
    };
    struct Entry {
        enum class Of {
            rho,
            absorption,    ///< -ln(1 - alpha) of a slice distance
            transmittance, ///< towards a light
            openness,
        };
        Origin origin;
        Of of = Of::rho;
        std::size_t group = 0; ///< of which rho is kept
        Vec3 direction{0.0};   ///< of transmittance: world, towards the light
        double step = 0.0;     ///< what an element was to span, world units; rho: 0
        double radius = 0.0;   ///< of openness, in slice distances
        bool turns = false;    ///< with the camera
        std::shared_ptr<const LightVolume> volume = nullptr;
        std::shared_ptr<const FollowedGrid> followed = nullptr; ///< of absorption, once a light was followed through it
    };

    /// Puts the entry first that is as `wanted`, or a new one with the volume make(), and counts it. What make() finds
    /// here is counted too.
    template <class Make>
    std::shared_ptr<const LightVolume> find(const Entry& wanted, std::size_t& used, const Make& make);
    /// Drops volumes of other fields and of lights that turn with the camera, and all beyond the limits of memory.
    void tidy(const Scene& scene, std::size_t used);

    std::vector<Entry> entries_; ///< the last used ones first
    std::weak_ptr<const LightVolume> absorption_;
};

} // namespace sheetsplat
