// The slices that a clip and a depth limit leave of each pixel, and those that belong to a part of a whole.
#include "view/kept_slices.hpp"

#include <limits>

#include <gtest/gtest.h>

namespace sheetsplat {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

/// Ten slices at depths 5, 5.5, ... 9.5.
Frame frame_of(Size size) {
    Frame frame;
    frame.size = size;
    frame.axis_x = 0.5 * size.width;
    frame.axis_y = 0.5 * size.height;
    frame.first_depth = 5.0;
    frame.slice_spacing = 0.5;
    frame.slices = 10;
    return frame;
}

Scene scene_of(Size size, std::vector<double> depths) {
    Scene scene{{}, TransferFunction({{0.0, Vec3(1.0), 0.0}, {1.0, Vec3(1.0), 1.0}})};
    scene.depth_limit = DepthLimit(size, std::move(depths));
    return scene;
}

TEST(SlicesInFront, AreThoseBeforeTheSurface) {
    const Scene scene = scene_of({4, 2}, {6.2, 6.0, 6.0 + 0.4e-6, 6.0 + 0.6e-6, 5.0, 4.5, -3.0, infinity});
    const SlicesInFront in_front(&*scene.depth_limit, frame_of({4, 2}));
    EXPECT_EQ(in_front.last(0, 0), 2);
    EXPECT_EQ(in_front.last(1, 0), 1) << "a point at the surface is cut off";
    EXPECT_EQ(in_front.last(2, 0), 1) << "and one nearer than a millionth of a slice distance";
    EXPECT_EQ(in_front.last(3, 0), 2);
    EXPECT_EQ(in_front.last(0, 1), -1) << "what lies before the first slice is kept";
    EXPECT_EQ(in_front.last(1, 1), -2);
    EXPECT_EQ(in_front.last(2, 1), -2);
    EXPECT_EQ(in_front.last(3, 1), 11);
    EXPECT_EQ(in_front.last(-1, 0), 11) << "nothing is known beyond the picture's edges";
    EXPECT_EQ(in_front.last(4, 0), 11);
    EXPECT_EQ(SlicesInFront(nullptr, frame_of({4, 2})).last(0, 0), 11);
}

TEST(KeptSlices, AreThoseOfClipAndSurface) {
    const Camera camera = Camera::orthographic({0, 0, 5}, {0, 0, 0}, {0, 1, 0}, 1.0);
    Scene scene = scene_of({2, 1}, {8.1, 5.6});
    scene.clip.planes = {{{0, 0, -1}, 1.2}}; // depths from 6.2 on
    DrawPlan plan;
    // Intervals begin and end at slices that there are not, too.
    plan.preintegration = true;
    const auto kept = [&](int column) { return KeptSlices(scene, plan, camera, frame_of({2, 1})).at(column, 0); };
    EXPECT_TRUE(kept(0).holds(0) && kept(0).holds(10));
    plan.clip = true;
    EXPECT_TRUE(!kept(0).holds(2) && kept(0).holds(3) && kept(0).holds(10));
    plan.depth_limit = true;
    EXPECT_TRUE(!kept(0).holds(2) && kept(0).holds(3) && kept(0).holds(6) && !kept(0).holds(7));
    for (int slice = -1; slice < 11; ++slice) {
        EXPECT_FALSE(kept(1).holds(slice)) << "the surface lies before the clip";
    }
    plan.clip = false;
    EXPECT_TRUE(kept(1).holds(-1) && kept(1).holds(1) && !kept(1).holds(2));
    plan.depth_limit = plan.preintegration = false;
    EXPECT_TRUE(!kept(0).holds(-1) && kept(0).holds(0) && kept(0).holds(9) && !kept(0).holds(10));
}

TEST(OwnedSlices, OfCellsThatShareAFaceAreEachOthersRest) {
    const Size size{9, 7};
    const Vec3 everywhere(infinity);
    for (const Camera& camera : {Camera::orthographic({0.3, 0.2, 7}, {0.1, 0, 0}, {0, 1, 0}, 4.0),
                                 Camera::perspective({0, 0, 7.2}, {0, 0, 0}, {0, 1, 0}, 60.0),
                                 Camera::orthographic({0, 0, 7}, {0, 0, 0}, {0, 1, 0}, 3.5)}) {
        Frame frame = frame_of(size);
        frame.projection = camera.projection();
        frame.pixel = 2.0 * camera.half_height() / size.height;
        for (int axis = 0; axis < 3; ++axis) {
            // The last ones lie on slices or on columns of pixels.
            for (const double face : {-0.37, 0.11, 0.5, 0.0}) {
                Part below{Box{-everywhere, everywhere}}, above = below;
                below.cell.box.upper[axis] = above.cell.box.lower[axis] = face;
                const OwnedSlices first(below, camera, frame), second(above, camera, frame);
                for (int pixel = 0; pixel < size.width * size.height; ++pixel) {
                    const int column = pixel % size.width, row = pixel / size.width;
                    const SliceRun mine = first.at(column, row), theirs = second.at(column, row);
                    for (int slice = -1; slice < 10; ++slice) {
                        EXPECT_NE(mine.holds(slice), theirs.holds(slice)) << axis << " " << face << " " << slice;
                    }
                    EXPECT_EQ(mine.holds(-1), mine.holds(0)) << "what lies before the first slice belongs to it";
                }
            }
        }
    }
}

TEST(OwnedSlices, AreThoseInTheCell) {
    const Camera camera = Camera::orthographic({0, 0, 5}, {0, 0, 0}, {0, 1, 0}, 1.0);
    const Vec3 everywhere(infinity);
    Part part{Box{-everywhere, everywhere}};
    EXPECT_FALSE(part.cuts());
    // Depths from 6 to 8, the first of them outside: z = 5 - depth lies below the upper end.
    part.cell.box.lower.z = -3.0;
    part.cell.box.upper.z = -1.0;
    EXPECT_TRUE(part.cuts());
    const SliceRun run = OwnedSlices(part, camera, frame_of({2, 1})).at(0, 0);
    EXPECT_TRUE(!run.holds(2) && run.holds(3) && run.holds(6) && !run.holds(7));
    part.cell.box.lower.x = 0.3;
    EXPECT_FALSE(OwnedSlices(part, camera, frame_of({2, 1})).at(0, 0).holds(3)) << "the pixel lies beside the cell";
}

} // namespace
} // namespace sheetsplat
