// Which slices and pixels ellipsoids reach, and how they are drawn.
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "view/ellipsoid_views.hpp"

namespace sheetsplat {
namespace {

// ---- which slices, which pixels

TEST(EllipsoidView, SpansAreTheSlicesThatMeetTheSupport) {
    std::size_t cut = 0, none = 0, checked = 0;
    for (const bool deep : {false, true}) {
        for (const Sampling sampling : {Sampling::point, Sampling::slab}) {
            for (const double spacing : {0.031, 0.4}) {
                // In perspective the eye stands among the kernels.
                const Camera camera = deep ? Camera::perspective(Vec3(0.1, 0.2, -0.1), Vec3(1.0, 0.5, 0.7),
                                                                 Vec3(0.0, 1.0, 0.0), 70.0, 0.3)
                                           : orthographic();
                const Look look(random_field(8, 300, 20.0), camera, {32, 32}, spacing, sampling);
                EXPECT_EQ(look.frame.cut_by_near, deep);
                for (std::size_t i = 0; i < look.field->size(); ++i) {
                    // Depths of the support from the ellipsoid itself.
                    const double center = -look.camera.to_eye(look.field->center(i)).z;
                    const double h = glm::length(glm::transpose(look.field->shape(i)) * look.camera.back_world());
                    const EllipsoidView::Span span = look.view.span(look.view.depths(i));
                    for (const int wider : {0, 1, 3}) {
                        const EllipsoidView::Span wide = look.view.span(look.view.depths(i), wider);
                        const double half = (sampling == Sampling::slab ? 0.5 * spacing : 0.0) + wider * spacing;
                        for (std::int64_t slice = 0; slice < look.frame.slices; ++slice) {
                            const double away = std::abs(look.frame.depth_of(slice) - center) - h - half;
                            const bool inside = wide.first <= slice && slice <= wide.last;
                            if (std::abs(away) > 1e-9) {
                                EXPECT_EQ(inside, away < 0.0) << "kernel " << i << " slice " << slice;
                                ++checked;
                            }
                        }
                    }
                    none += span.first > span.last ? 1 : 0;
                    cut += span.first <= span.last && center - h < look.frame.depth_of(0) - spacing ? 1 : 0;
                }
            }
        }
    }
    EXPECT_GT(cut, 50U) << "kernels that reach through the near plane";
    EXPECT_GT(none, 50U) << "kernels that no slice meets";
    EXPECT_GT(checked, 100000U);
}

// Points of a support, inside and on its edge.
std::vector<Vec3> points_of(const Look& look, std::size_t i, Random& random, int count) {
    std::vector<Vec3> points;
    const Mat3 m = look.field->shape(i);
    while (static_cast<int>(points.size()) < count) {
        const Vec3 q = 2.0 * random.in_cube() - (random.in_cube() - random.in_cube());
        const double length = glm::length(q);
        if (length > 1e-3) {
            points.push_back(look.field->center(i) +
                             m * (q / length * (random.chance(0.8) ? 1.0 : random.uniform(0.0, 1.0))));
        }
    }
    return points;
}

TEST(EllipsoidView, BoundsHoldAllPixelsOfTheSupport) {
    Random random(9);
    std::size_t seen = 0, unbounded = 0, clipped = 0;
    double largest_slack = 0.0;
    for (const bool deep : {false, true}) {
        for (const Filter filter : {Filter::none, Filter::ewa}) {
            for (const double aspect : {1.0, 30.0}) {
                const double spacing = aspect == 1.0 ? 0.1 : 0.17;
                const Camera camera = deep ? Camera::perspective(Vec3(0.1, 0.2, -0.1), Vec3(1.0, 0.5, 0.7),
                                                                 Vec3(0.0, 1.0, 0.0), 70.0, 0.001)
                                           : orthographic(1.2);
                const Look look(random_field(10, 60, aspect), camera, {50, 36}, spacing, Sampling::slab, filter);
                const Tile tile{7, 5, 21, 19};
                for (std::size_t i = 0; i < look.field->size(); ++i) {
                    const EllipsoidView::Span span = look.view.span(look.view.depths(i));
                    if (span.first > span.last) {
                        continue;
                    }
                    const double front = look.view.front_of(span.first), back = look.view.back_of(span.last);
                    const EyeKernel kernel = look.view.kernel(i);
                    const EllipsoidView::ScreenBounds bounds = look.view.bounds(kernel, front, back);
                    const EllipsoidView::ScreenBounds same = look.view.support_bounds(i, front, back);
                    EXPECT_EQ(bounds.unbounded, same.unbounded);
                    for (const auto& [a, b] : {std::array<double, 2>{bounds.left, same.left},
                                               {bounds.right, same.right},
                                               {bounds.top, same.top},
                                               {bounds.bottom, same.bottom}}) {
                        EXPECT_NEAR(a, b, 1e-9 * (1.0 + std::abs(a)));
                    }
                    unbounded += bounds.unbounded ? 1 : 0;
                    const PixelBox box = EllipsoidView::pixels(bounds, look.frame, tile, 0);
                    const PixelBox wider = EllipsoidView::pixels(bounds, look.frame, tile, 3);
                    EXPECT_TRUE(wider.x0 <= box.x0 && wider.y0 <= box.y0 && wider.x1 >= box.x1 && wider.y1 >= box.y1);
                    EXPECT_TRUE(wider.x1 <= tile.target_width() && wider.y1 <= tile.target_height());
                    double left = 1e300, right = -1e300;
                    for (const Vec3& point : points_of(look, i, random, 200)) {
                        const Vec3 eye = look.camera.to_eye(point);
                        const double depth = -eye.z;
                        if (deep && (depth < front || depth > back || depth <= 1e-6)) {
                            continue;
                        }
                        const double scale = look.frame.pixel * (deep ? depth : 1.0);
                        const double x = eye.x / scale, y = -eye.y / scale;
                        left = std::min(left, x);
                        right = std::max(right, x);
                        const double slack = 1e-9 * (1.0 + std::abs(x) + std::abs(y));
                        const bool inside =
                            bounds.unbounded || (x >= bounds.left - slack && x <= bounds.right + slack &&
                                                 y >= bounds.top - slack && y <= bounds.bottom + slack);
                        EXPECT_TRUE(inside) << "kernel " << i << " at " << x << ", " << y;
                        // Target pixel of the tile.
                        const double tx = std::floor(x + 25.0 - tile.x + 1.0), ty = std::floor(y + 18.0 - tile.y + 1.0);
                        if (tx >= 0.0 && ty >= 0.0 && tx < tile.target_width() && ty < tile.target_height()) {
                            EXPECT_TRUE(tx >= box.x0 && tx < box.x1 && ty >= box.y0 && ty < box.y1)
                                << "kernel " << i << " at " << tx << ", " << ty;
                            ++seen;
                        } else {
                            ++clipped;
                        }
                    }
                    if (!deep && filter == Filter::none && aspect == 1.0) {
                        largest_slack = std::max({largest_slack, (left - bounds.left) / (right - left),
                                                  (bounds.right - right) / (right - left)});
                    }
                }
            }
        }
    }
    EXPECT_GT(seen, 2000U);
    EXPECT_GT(clipped, 2000U);
    EXPECT_GT(unbounded, 5U);
    EXPECT_LT(largest_slack, 0.1) << "bounds of spheres that are no bounds";
}

TEST(EllipsoidView, BoundsEndWhereTheSupportDoes) {
    // One ellipsoid with its axes along the eye's, in pixels of 0.1 and, in perspective, of 0.1 at depth 1.
    EllipsoidArrays arrays;
    arrays.centers = {Vec3(1.0, 0.5, -4.0)};
    arrays.scales = {Vec3(0.2, 0.3, 2.0)};
    arrays.values = {1.0};
    const auto field = field_of(std::move(arrays));
    const Look flat(field, Camera::orthographic(Vec3(0.0), Vec3(0.0, 0.0, -1.0), Vec3(0.0, 1.0, 0.0), 2.0), {40, 20},
                    0.5);
    const EllipsoidView::ScreenBounds whole = flat.view.support_bounds(0, 0.0, 10.0);
    EXPECT_FALSE(whole.unbounded);
    EXPECT_NEAR(whole.left, 8.0, 1e-12);
    EXPECT_NEAR(whole.right, 12.0, 1e-12);
    EXPECT_NEAR(whole.top, -8.0, 1e-12);
    EXPECT_NEAR(whole.bottom, -2.0, 1e-12);
    // Pixel 0 of the targets is the border's; the axis meets pixel corner 20, 10 of the picture.
    const PixelBox box = EllipsoidView::pixels(whole, flat.frame, {0, 0, 40, 20}, 0);
    EXPECT_LE(box.x0, 29);
    EXPECT_GE(box.x0, 27);
    EXPECT_GE(box.x1, 33);
    EXPECT_LE(box.x1, 35);
    EXPECT_LE(box.y0, 3);
    EXPECT_GE(box.y1, 9);
    EXPECT_TRUE(EllipsoidView::pixels(whole, flat.frame, {0, 0, 20, 20}, 0).empty()) << "beside the tile";
    EXPECT_FALSE(EllipsoidView::pixels(whole, flat.frame, {20, 0, 20, 20}, 0).empty());

    const Look deep(field,
                    Camera::perspective(Vec3(0.0), Vec3(0.0, 0.0, -1.0), Vec3(0.0, 1.0, 0.0),
                                        2.0 * std::atan(1.0) * 180.0 / pi, 1e-3),
                    {40, 20}, 0.5);
    EXPECT_NEAR(deep.frame.pixel, 0.1, 1e-12);
    const EllipsoidView::ScreenBounds cut = deep.view.support_bounds(0, 2.5, 5.0);
    EXPECT_NEAR(cut.left, 0.8 / 5.0 * 10.0, 1e-12);
    EXPECT_NEAR(cut.right, 1.2 / 2.5 * 10.0, 1e-12);
    EXPECT_NEAR(cut.top, -0.8 / 2.5 * 10.0, 1e-12);
    EXPECT_NEAR(cut.bottom, -0.2 / 5.0 * 10.0, 1e-12);
    EXPECT_NEAR(deep.view.support_bounds(0, 0.0, 10.0).right, 1.2 / 2.0 * 10.0, 1e-12) << "no nearer than its support";
    EXPECT_FALSE(deep.view.support_bounds(0, -1.0, 10.0).unbounded);

    EllipsoidArrays around;
    around.centers = {Vec3(0.0, 0.0, -1.0)};
    around.radii = {1.5};
    around.values = {1.0};
    const Look inside(field_of(std::move(around)),
                      Camera::perspective(Vec3(0.0), Vec3(0.0, 0.0, -1.0), Vec3(0.0, 1.0, 0.0), 60.0, 1e-3), {8, 8},
                      0.5);
    EXPECT_TRUE(inside.view.support_bounds(0, -0.1, 1.0).unbounded);
    EXPECT_TRUE(inside.view.support_bounds(0, 0.0, 1.0).unbounded);
    EXPECT_FALSE(inside.view.support_bounds(0, 0.1, 1.0).unbounded);
    const Tile tile{2, 1, 4, 5};
    const PixelBox all = EllipsoidView::pixels(inside.view.support_bounds(0, 0.0, 1.0), inside.frame, tile, 0);
    EXPECT_TRUE(all.x0 == 0 && all.y0 == 0 && all.x1 == tile.target_width() && all.y1 == tile.target_height());
}

// ---- how kernels are drawn

TEST(EllipsoidView, SpritesAreSmallSpheresInOrthographicView) {
    EllipsoidArrays round, oval;
    for (const double radius : {0.01, 0.2, 0.5}) {
        round.centers.emplace_back(radius, 0.0, 0.0);
        round.radii.push_back(radius);
        round.values.push_back(1.0);
        oval.centers.emplace_back(radius, 0.0, 0.0);
        oval.scales.emplace_back(radius, radius, radius);
        oval.values.push_back(1.0);
    }
    const auto spheres = field_of(std::move(round));
    const auto ovals = field_of(std::move(oval));
    const auto groups = [](const Look& look, double sprite_px) {
        std::vector<bool> sprites;
        for (std::size_t i = 0; i < look.field->size(); ++i) {
            sprites.push_back(look.view.group(i, look.view.depths(i), sprite_px, never) == SectionGroup::sprite);
        }
        return sprites;
    };
    // Radii of 0.2, 4 and 10 pixels.
    const Size size{50, 50};
    const Look look(spheres, orthographic(2.5), size, 0.05);
    EXPECT_TRUE(look.view.spheres());
    EXPECT_EQ(groups(look, 5.0), (std::vector<bool>{true, true, false}));
    EXPECT_EQ(groups(look, 10.1), (std::vector<bool>{true, true, true}));
    EXPECT_EQ(groups(look, 0.0), (std::vector<bool>{false, false, false}));
    const std::vector<bool> none{false, false, false};
    EXPECT_EQ(groups(Look(spheres, orthographic(2.5), size, 0.05, Sampling::slab), 100.0), none);
    EXPECT_EQ(groups(Look(spheres, orthographic(2.5), size, 0.05, Sampling::point, Filter::ewa), 100.0), none);
    EXPECT_EQ(groups(Look(spheres, perspective(), size, 0.05), 100.0), none);
    EXPECT_EQ(groups(Look(ovals, orthographic(2.5), size, 0.05), 100.0), none);
}

TEST(EllipsoidView, SlabsAreThinMediumOrThickAgainstTheKernel) {
    std::array<int, section_groups> count{};
    for (const double spacing : {0.005, 0.03, 0.2}) {
        for (const double aspect : {1.0, 40.0}) {
            const Look look(random_field(11, 120, aspect), orthographic(), {50, 50}, spacing, Sampling::slab);
            const double k = look.field->kernel().falloff;
            for (std::size_t i = 0; i < look.field->size(); ++i) {
                // |B^-1 e_z| ds: how far the ray gets through the unit sphere in a slab, by the inverse itself.
                const Vec3 w = glm::inverse(look.in_eye(i)) * Vec3(0.0, 0.0, 1.0);
                const double width = std::sqrt(k) * glm::length(w) * spacing;
                const SectionGroup group = look.view.group(i, look.view.depths(i), 100.0, never);
                if (std::abs(width - 0.6) > 1e-6 && std::abs(width - 1.5) > 1e-6) {
                    EXPECT_EQ(group, width < 0.6   ? SectionGroup::thin
                                     : width < 1.5 ? SectionGroup::medium
                                                   : SectionGroup::thick)
                        << width;
                }
                ++count[static_cast<std::size_t>(group)];
            }
        }
    }
    EXPECT_GT(count[static_cast<std::size_t>(SectionGroup::thin)], 20);
    EXPECT_GT(count[static_cast<std::size_t>(SectionGroup::medium)], 20);
    EXPECT_GT(count[static_cast<std::size_t>(SectionGroup::thick)], 20);
}

TEST(EllipsoidView, SlabsAreNeverThoughtThinnerThanTheyAre) {
    // Where rays differ from pixel to pixel, and where a filter hides the axes, bounds decide.
    int thin = 0;
    for (const bool deep : {false, true}) {
        for (const Filter filter : {Filter::none, Filter::ewa}) {
            for (const double spacing : {0.005, 0.03, 0.2}) {
                const Look look(random_field(12, 100, 40.0), deep ? perspective() : orthographic(), {50, 40}, spacing,
                                Sampling::slab, filter);
                const double root = std::sqrt(look.field->kernel().falloff);
                for (std::size_t i = 0; i < look.field->size(); ++i) {
                    const EyeKernel kernel = look.view.kernel(i);
                    double widest = 0.0;
                    for (const double x : {-25.0, 0.0, 25.0}) {
                        for (const double y : {-20.0, 0.0, 20.0}) {
                            // From one slab to the next the ray moves (X, Y, -1) ds: in the plane of the unit sphere
                            // against the section's own movement.
                            const glm::dvec2 ray = deep ? look.frame.pixel * glm::dvec2(x, y) : glm::dvec2(0.0);
                            const glm::dvec2 across = ray + kernel.lean / kernel.half_depth;
                            const glm::dvec2 in_plane(
                                glm::dot(across, kernel.axis_u) / glm::dot(kernel.axis_u, kernel.axis_u),
                                glm::dot(across, kernel.axis_v) / glm::dot(kernel.axis_v, kernel.axis_v));
                            widest = std::max(widest, std::hypot(glm::length(in_plane), 1.0 / kernel.half_depth));
                        }
                    }
                    const double width = root * widest * spacing;
                    const SectionGroup group = look.view.group(i, look.view.depths(i), 100.0, never);
                    if (group == SectionGroup::thin) {
                        EXPECT_LE(width, 0.6 * (1.0 + 1e-9)) << i;
                        ++thin;
                    } else if (group == SectionGroup::medium) {
                        EXPECT_LE(width, 1.5 * (1.0 + 1e-9)) << i;
                    }
                }
            }
        }
    }
    EXPECT_GT(thin, 50);
}

TEST(EllipsoidView, SlenderKernelsArePlacedInFloat64) {
    EllipsoidArrays arrays;
    for (const double aspect : {1.0, 99.0, 100.0, 1e5}) {
        for (const Vec3 axes : {Vec3(aspect, 1.0, 1.0), Vec3(1.0, aspect, aspect)}) {
            arrays.centers.emplace_back(0.1 * static_cast<double>(arrays.centers.size()));
            arrays.scales.push_back(0.01 * axes);
            arrays.values.push_back(1.0);
        }
    }
    const auto field = field_of(std::move(arrays));
    for (const bool deep : {false, true}) {
        for (const Sampling sampling : {Sampling::point, Sampling::slab}) {
            for (const double spacing : {0.004, 0.02, 0.2}) {
                // From a hundred times as far, at an angle that leaves pixels as small.
                const Look look(field, deep ? perspective(100.0, 1e-3, 0.5) : orthographic(), {50, 50}, spacing,
                                sampling);
                for (std::size_t i = 0; i < field->size(); ++i) {
                    const SectionGroup group = look.view.group(i, look.view.depths(i), 5.0, 100.0);
                    const SectionGroup usual = look.view.group(i, look.view.depths(i), 5.0, never);
                    EXPECT_FALSE(is_precise(usual));
                    if (i < 4) {
                        EXPECT_EQ(group, usual);
                    } else if (sampling == Sampling::point) {
                        EXPECT_EQ(group, SectionGroup::precise_plain);
                    } else {
                        EXPECT_EQ(group, usual == SectionGroup::thin     ? SectionGroup::precise_thin
                                         : usual == SectionGroup::medium ? SectionGroup::precise_medium
                                                                         : SectionGroup::precise_thick);
                    }
                }
            }
        }
    }
}

TEST(EllipsoidView, TinyKernelsArePlacedInFloat64) {
    for (const bool deep : {false, true}) {
        // Pixels of 0.05 at the middle's depth, in both cameras.
        const Vec3 from(0.0, 0.0, 50.0), up(0.0, 1.0, 0.0);
        const Camera camera = deep ? Camera::perspective(from, Vec3(0.0), up, 2.0 * std::atan(0.025) * 180.0 / pi)
                                   : Camera::orthographic(from, Vec3(0.0), up, 2.5);
        for (const bool flat : {false, true}) {
            EllipsoidArrays arrays;
            for (const double px : {0.011, 0.009, 1e-6, 3.0}) {
                arrays.centers.emplace_back(0.0);
                if (flat) {
                    arrays.scales.push_back(0.05 * px * Vec3(1.0, 2.0, 3.0));
                } else {
                    arrays.radii.push_back(0.05 * px);
                }
                arrays.values.push_back(1.0);
            }
            const auto field = field_of(std::move(arrays));
            for (const Sampling sampling : {Sampling::point, Sampling::slab}) {
                const Look look(field, camera, {50, 50}, 0.02, sampling);
                const Look wide(field, camera, {50, 50}, 0.02, sampling, Filter::ewa);
                for (std::size_t i = 0; i < field->size(); ++i) {
                    const EllipsoidView::Depths depths = look.view.depths(i);
                    EXPECT_EQ(is_precise(look.view.group(i, depths, 5.0, 100.0)), i == 1 || i == 2);
                    EXPECT_FALSE(is_precise(look.view.group(i, depths, 5.0, never))) << "float64 is not there";
                    EXPECT_FALSE(is_precise(wide.view.group(i, wide.view.depths(i), 5.0, 100.0)))
                        << "a filtered kernel is no smaller than a pixel";
                }
            }
        }
    }
}

TEST(EllipsoidView, WhatLiesBetweenTheCentresOfPixelsIsNotDrawn) {
    const Frame frame = [] {
        Frame made;
        made.size = {10, 10};
        return made;
    }();
    const Tile tile = [] {
        Tile made;
        made.width = made.height = 10;
        return made;
    }();
    // Centres lie at halves, counted from the optical axis.
    const auto drawn = [&](double left, double right, int wider) {
        const PixelBox box = EllipsoidView::pixels({left, right, 0.2, 1.3, false}, frame, tile, wider);
        return box.x0 < box.x1 && box.y0 < box.y1;
    };
    EXPECT_TRUE(drawn(0.4, 0.6, 0));
    EXPECT_TRUE(drawn(0.5 - 1e-12, 0.5 + 1e-12, 0));
    EXPECT_FALSE(drawn(0.51, 1.49, 0));
    EXPECT_TRUE(drawn(0.51, 1.51, 0));
    EXPECT_FALSE(drawn(-0.49, 0.49, 0));
    EXPECT_TRUE(drawn(0.51, 1.49, 1)) << "gradients look one pixel further";
}

} // namespace
} // namespace sheetsplat
