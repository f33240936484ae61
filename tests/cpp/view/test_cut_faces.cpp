// The faces of cuts through which pixels' rays come, and what their normals count.
#include "view/cut_faces.hpp"

#include <cmath>
#include <limits>

#include <glm/geometric.hpp>
#include <gtest/gtest.h>

#include "facts/frame.hpp"

namespace sheetsplat {
namespace {

/// Slices at depths 5, 5.5, ...; pixels are as high as the picture.
Frame frame_of(const Camera& camera, Size size) {
    Frame frame;
    frame.size = size;
    frame.projection = camera.projection();
    frame.pixel = 2.0 * camera.half_height() / size.height;
    frame.axis_x = 0.5 * size.width;
    frame.axis_y = 0.5 * size.height;
    frame.first_depth = 5.0;
    frame.slice_spacing = 0.5;
    frame.slices = 20;
    return frame;
}

CutFace face_of(const Scene& scene, const Camera& camera, int column, bool clip = true) {
    const Size size{5, 5};
    DrawPlan plan;
    plan.clip = clip;
    return CutFaces(scene, plan, camera, frame_of(camera, size)).at(0, column, 2);
}

const Scene bare{{}, TransferFunction({{0.0, Vec3(1.0), 0.0}, {1.0, Vec3(1.0), 1.0}})};
const Camera orthographic = Camera::orthographic({0, 0, 5}, {0, 0, 0}, {0, 1, 0}, 5.0);
const Camera perspective = Camera::perspective({0, 0, 5}, {0, 0, 0}, {0, 1, 0}, 90.0);

TEST(CutFaces, AreWhereRaysEnter) {
    Scene scene = bare;
    scene.clip.planes = {{{1, 0, -2}, 3.5}, {{0, 0, 1}, -9.0}, {{1, 0, 0}, -50.0}}; // x - 2 z >= 3.5
    for (const int column : {0, 2, 4}) {
        const double x = column - 2.0;
        const CutFace face = face_of(scene, orthographic, column);
        // z = (x - 3.5) / 2 at depth 5 - z; a millionth of a slice distance is allowed.
        EXPECT_NEAR(face.slice, (x - 3.5) / -2.0 / 0.5, 1e-5);
        EXPECT_LT(glm::length(face.normal - Vec3(-1, 0, 2) / std::sqrt(5.0)), 1e-15);
        // Along (x / 2.5, 0, -1): x t / 2.5 - 2 (5 - t) = 3.5.
        const double slope = x / 2.5;
        EXPECT_NEAR(face_of(scene, perspective, column).slice, (13.5 / (slope + 2.0) - 5.0) / 0.5, 1e-5);
    }
    EXPECT_EQ(face_of(scene, orthographic, 2, false).slice, -std::numeric_limits<double>::infinity());
}

TEST(CutFaces, OfSeveralTheLastCountsAndOfThoseInOnePlaceTheFirst) {
    Scene scene = bare;
    scene.clip.planes = {{{0, 0, -1}, 1.0}, {{1, 0, -1}, 1.0}};
    // At depths 6 and 6 - x.
    EXPECT_NEAR(face_of(scene, orthographic, 0).slice, 6.0, 1e-5);
    EXPECT_NEAR(face_of(scene, orthographic, 4).slice, 2.0, 1e-5);
    EXPECT_EQ(face_of(scene, orthographic, 2).normal, Vec3(0, 0, 1));
    scene.clip.planes[1].offset += 2e-3;
    EXPECT_NE(face_of(scene, orthographic, 2).normal, Vec3(0, 0, 1));
}

TEST(CutFaces, OfAPolyhedronThatStandsForASphereAreRound) {
    Scene scene = bare;
    scene.clip.planes = {{{0, 0, -1}, 1.0, Vec3(0, 0, -4)}};
    // The entry is at (x, 0, -1).
    const CutFace face = face_of(scene, orthographic, 3);
    EXPECT_LT(glm::length(face.normal - glm::normalize(Vec3(1, 0, 3))), 1e-6);
}

TEST(CutFaces, CountAsFarAsTheMatterBehindThemIsOpaque) {
    CutFace face;
    face.slice = 3.25;
    const double infinite = std::numeric_limits<double>::infinity();
    EXPECT_EQ(face.share(4.0, infinite, 0.0, 1.0), 1.0) << "opaque matter";
    EXPECT_LT(face.share(4.0, 1e-300, 0.0, 1.0), 1e-299) << "none";
    EXPECT_NEAR(face.share(4.0, 0.3, 0.0, 1.0), -std::expm1(-4.0 * 0.3), 1e-15);
    EXPECT_NEAR(face.share(4.0, 0.1, 0.0, 3.0), -std::expm1(-4.0 * 0.3), 1e-15) << "of slices that are closer";
    // In homogeneous matter the share stays until four lengths, and ends at eight.
    const auto inside = [&](double behind) { return -std::expm1(-0.3 * std::floor(behind)); };
    for (const double behind : {1.75, 3.5, 4.0}) {
        EXPECT_NEAR(face.share(3.25 + behind, 0.3, inside(behind), 1.0), -std::expm1(-1.2), 1e-15);
    }
    EXPECT_NEAR(face.share(9.25, 0.3, inside(6.0), 1.0), 0.5 * -std::expm1(-1.2), 1e-12);
    EXPECT_EQ(face.share(11.25, 0.3, inside(8.0), 1.0), 0.0);
    // Behind a gap of 1 to 2 lengths it ends.
    EXPECT_NEAR(face.share(4.75, infinite, 0.0, 1.0), 0.5, 1e-15);
    EXPECT_EQ(face.share(5.25, infinite, 0.0, 1.0), 0.0);
    EXPECT_EQ(CutFace{}.share(4.0, infinite, 0.0, 1.0), 0.0) << "there is no face";
}

} // namespace
} // namespace sheetsplat
