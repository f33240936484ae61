// Pictures that grow front to back from the sheets. Source: conventions, sections 6 and 7.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <vector>

#include "reference/clip.hpp"
#include "reference/counted.hpp"
#include "reference/reference.hpp"
#include "reference/screen.hpp"
#include "reference/shade.hpp"
#include "reference/slices.hpp"
#include "reference/sums.hpp"
#include "reference/surroundings.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat::reference {

/// The sheets of slices n - 1, n, n + 1 and n + 2 of each group; blank where there is no slice.
struct SheetWindow {
    std::int64_t n = 0;
    std::vector<std::array<const Sheet*, 4>> groups;
};

/// How far section 9 moves the arithmetic behind the sheets.
struct Nudge {
    double rho = 0.0;  ///< share of v_max - v_min
    double stop = 0.0; ///< added to A_stop
};

/// True where light or opacity depends on gradients.
bool calls_for_gradients(const Scene& scene);

/// One picture. The sheets may feed several that differ in their nudges.
class Compositor {
  public:
    /// What is referred to must live as long as this.
    Compositor(const CountedScene& counted, const Camera& camera, const Screen& screen, const Slices& slices,
               const Shader& shader, const Clipping& clipping, const Cell& cell, const Surroundings* surroundings,
               const Request& request, const Nudge& nudge);

    /// Adds slice n, or the interval from slice n to n + 1 in isosurface mode and with preintegration. Wanted for every
    /// n in turn, from the one before the first slice to the last.
    /// `poll` is called between rows of pixels that look around themselves, which takes long.
    void add(const SheetWindow& window, const std::function<void()>& poll);
    /// The picture, background behind it.
    [[nodiscard]] Picture finish();

  private:
    struct Pixel {
        int column, row;
        std::size_t number;
        double lengths; // reference lengths that the pixel's ray goes through in one slab
    };

    /// A group's sheets as one pixel sees them.
    struct View {
        const SheetWindow& window;
        const Pixel& pixel;
        std::size_t group;

        [[nodiscard]] const Sheet& sheet(std::size_t ahead) const { return *window.groups[group][1 + ahead]; }
        [[nodiscard]] std::size_t index() const { return sheet(0).index(pixel.column, pixel.row); }
        [[nodiscard]] double rho(std::size_t ahead) const { return sheet(ahead).rho[index()]; }
        [[nodiscard]] bool reached(std::size_t ahead) const { return sheet(ahead).reached[index()] != 0; }
    };
    /// Where rho of a group passes an iso value between two slices.
    struct Crossing {
        double share; ///< of the way from the front slice to the back one
        std::size_t group;
        const IsoValue* iso;
    };

    void add_coverage(const SheetWindow& window, const Pixel& pixel);
    void add_slice(const SheetWindow& window, const Pixel& pixel);
    void add_interval(const SheetWindow& window, const Pixel& pixel);
    void add_second_order_interval(const SheetWindow& window, const Pixel& pixel);
    void add_crossings(const SheetWindow& window, const Pixel& pixel);
    void add_scalar(const SheetWindow& window, const Pixel& pixel);

    /// Crossings between slices n and n + 1, the nearest first.
    [[nodiscard]] std::vector<Crossing> find_crossings(const SheetWindow& window, const Pixel& pixel) const;
    /// True where clipping and the depth limit keep the point of slice n + ahead.
    [[nodiscard]] bool kept(const SheetWindow& window, const Pixel& pixel, std::size_t ahead) const;
    /// True where a group has not ended at the point of slice n + ahead.
    [[nodiscard]] bool inside(const View& view, std::size_t ahead) const;
    /// True where slice n, and what lies between it and the next one, belongs to the part that is drawn.
    [[nodiscard]] bool owned(const SheetWindow& window, const Pixel& pixel) const;
    /// True where the interval behind slice n shows a group: an end is neither empty nor cut off.
    [[nodiscard]] bool open_interval(const View& view) const;
    /// Per reference length.
    [[nodiscard]] Vec3 gradient(const View& view, std::size_t ahead) const;
    [[nodiscard]] Vec3 gradient_of_interval(const View& view) const;
    /// The factor of gradient opacity; 1 without it.
    [[nodiscard]] double gradient_share(const Vec3& gradient) const;
    /// The colour of a group that takes it from others, so far behind slice n; its own where these are empty.
    [[nodiscard]] Vec3 color_of(const View& view, const Vec3& own, double share) const;
    /// The same over the interval behind slice n.
    [[nodiscard]] Vec3 color_of_interval(const View& view, const Vec3& own) const;
    /// Sets the normal of the cut through which the ray came, and what it counts.
    void turn_to_face(const View& view, double depth, double extinction, Lighting& lighting) const;
    /// The colour of a group that is composited: lit, and faded with depth. extinction: of its slice or interval.
    [[nodiscard]] Vec3 shaded(const View& view, const Vec3& color, const Vec3& gradient, double depth,
                              double extinction) const;
    [[nodiscard]] double middle_of_interval(const SheetWindow& window) const;
    /// What the picture reports as the depth of an interval.
    [[nodiscard]] double depth_of_interval(const SheetWindow& window) const;
    [[nodiscard]] bool stopped(const Pixel& pixel) const;
    void put_behind(const Pixel& pixel, const Vec3& color, double alpha, double depth);

    const CountedScene& counted_;
    const Scene& scene_;
    const Screen& screen_;
    const Slices& slices_;
    const Shader& shader_;
    const Clipping& clipping_;
    const Cell& cell_;
    const Surroundings* surroundings_; ///< null without shadows and ambient occlusion
    bool needs_gradient_;
    std::vector<Group> groups_;
    std::vector<Clipping> ends_; ///< of the groups
    double nudge_;
    std::vector<double> rho_shifts_; ///< what the nudge comes to in each group
    double stop_;
    double reference_distance_;  ///< world units
    std::vector<double> counts_; ///< slices that count, a pixel; modes of counts_weighted_slices()
    Picture picture_;
};

} // namespace sheetsplat::reference
