#include "backend_cpu/face_planes.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "backend_cpu/cpu_renderer.hpp"
#include "scene/mode_rules.hpp"
#include "view/cut_faces.hpp"

namespace sheetsplat::backend_cpu {

namespace {

/// So far in front of all slices that nothing is near.
constexpr double far_in_front = -1e15;

} // namespace

template <class T>
void set_faces(const Job& job, const TileShape& shape, T* next, TilePicture<T>& picture) {
    const CutFaces faces(*job.scene, *job.plan, *job.camera, *job.frame);
    for (std::size_t group = 0; group < groups_drawn(*job.scene).size(); ++group) {
        std::array<T*, face_planes> planes{};
        for (T*& plane : planes) {
            plane = next;
            next += shape.picture_elements();
        }
        for (int y = 0; y < shape.height; ++y) {
            for (int x = 0; x < shape.width; ++x) {
                const CutFace face = faces.at(group, shape.x + x, shape.y + y);
                const double place = std::max(face.slice, far_in_front), slice = std::floor(place);
                const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(y) * shape.stride + x;
                const std::array<double, face_planes> values{slice, place - slice, face.normal.x, face.normal.y,
                                                             face.normal.z};
                for (std::size_t plane = 0; plane < face_planes; ++plane) {
                    planes[plane][at] = static_cast<T>(values[plane]);
                }
            }
        }
        picture.faces.push_back({planes[0], planes[1], {planes[2], planes[3], planes[4]}});
    }
}

template void set_faces<float>(const Job&, const TileShape&, float*, TilePicture<float>&);
template void set_faces<double>(const Job&, const TileShape&, double*, TilePicture<double>&);

} // namespace sheetsplat::backend_cpu
