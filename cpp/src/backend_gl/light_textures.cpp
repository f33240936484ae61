#include "light_textures.hpp"

#include <algorithm>
#include <string>

#include <glm/geometric.hpp>

#include "interop.h"
#include "light/surface_lines.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat::backend_gl {

namespace {

const LightVolume& bright() {
    static const LightVolume one{Vec3(0.0), {Vec3(0.0), Vec3(0.0), Vec3(0.0)}, {1, 1, 1}, {1.0F}};
    return one;
}

const LightVolume& volume_of(const std::shared_ptr<const LightVolume>& volume) { return volume ? *volume : bright(); }

} // namespace

void LightTextures::upload(const LightVolumes& volumes, bool shadows, bool occlusion, int largest) {
    std::vector<std::shared_ptr<const LightVolume>> wanted = volumes.groups;
    if (shadows && volumes.groups.empty()) {
        wanted = volumes.lights;
    }
    if (occlusion && volumes.groups.empty()) {
        wanted.push_back(volumes.openness);
    }
    if (wanted == volumes_ && texture_) {
        return;
    }
    volumes_.clear();
    std::size_t elements = 0;
    for (const auto& volume : wanted) {
        elements += volume_of(volume).values.size();
    }
    if (elements > static_cast<std::size_t>(largest)) {
        throw Unsupported(Complaint{
            "shadows and ambient occlusion cannot be drawn with backend gl",
            std::to_string(elements) + " opacities along rays to lights",
            "at most " + std::to_string(largest) + ", which a buffer texture of this device holds",
            "use a larger " + option_ref("slice_spacing") + ", fewer lights, or " + option_ref("backend", "cpu")});
    }
    auto* to = static_cast<float*>(buffer_.map(elements * sizeof(float)));
    for (const auto& volume : wanted) {
        to = std::copy(volume_of(volume).values.begin(), volume_of(volume).values.end(), to);
    }
    buffer_.unmap();
    texture_ = gl::BufferTexture(*gl_, GL_R32F, buffer_);
    volumes_ = std::move(wanted);
}

void LightTextures::bind(const gl::Program& program, const Camera& camera, const Frame& frame,
                         std::int64_t first_slab) const {
    texture_.bind(UNIT_LIGHT_VOLUMES);
    program.set("volume_texture", UNIT_LIGHT_VOLUMES);
    std::vector<float> last, place, right, down, back;
    const Vec3 on_axis = camera.eye() - frame.depth_of(first_slab) * camera.back_world();
    std::size_t first = 0;
    for (std::size_t number = 0; number < volumes_.size(); ++number) {
        const LightVolume& volume = volume_of(volumes_[number]);
        program.set("volume_first[" + std::to_string(number) + "]", static_cast<int>(first));
        first += volume.values.size();
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const Vec3& per_step = volume.per_step[axis];
            const auto append = [](std::vector<float>& to, double value) { to.push_back(static_cast<float>(value)); };
            append(last, volume.counts[axis] - 1);
            append(place, glm::dot(on_axis - volume.origin, per_step));
            append(right, frame.pixel * glm::dot(camera.right_world(), per_step));
            append(down, -frame.pixel * glm::dot(camera.up_world(), per_step));
            append(back, -frame.slice_spacing * glm::dot(camera.back_world(), per_step));
        }
    }
    const int count = static_cast<int>(volumes_.size());
    program.set_array3("volume_last", last.data(), count);
    program.set_array3("volume_place", place.data(), count);
    program.set_array3("volume_right", right.data(), count);
    program.set_array3("volume_down", down.data(), count);
    program.set_array3("volume_back", back.data(), count);
}

void LightTextures::set_lines(const gl::Program& program, const Scene& scene, const Camera& camera,
                              double slice_spacing, double value_unit) const {
    const SurfaceLines lines =
        make_surface_lines(scene, camera, volume_of(volumes_.front()), slice_spacing, value_unit);
    std::vector<float> surfaces, lights, around, normals, distances;
    const auto append = [](std::vector<float>& to, const Vec3& vector) {
        to.insert(to.end(), {static_cast<float>(vector.x), static_cast<float>(vector.y), static_cast<float>(vector.z)});
    };
    std::size_t most = 0, most_surfaces = 0;
    for (std::size_t group = 0; group < lines.surfaces.size(); ++group) {
        most = std::max(most, lines.kept[group].size());
        most_surfaces = std::max(most_surfaces, lines.surfaces[group].size());
    }
    for (std::size_t group = 0; group < lines.surfaces.size(); ++group) {
        // (Groups with fewer surfaces than others get some that absorb nothing.)
        std::vector<SurfaceLines::Surface> own = lines.surfaces[group];
        own.resize(most_surfaces, {0.0, 0.0});
        for (const SurfaceLines::Surface& one : own) {
            append(surfaces, Vec3(one.value, one.absorption, 0.0));
        }
        // (Groups without an end of their own get half spaces that hold everything.)
        std::vector<SurfaceLines::Kept> kept = lines.kept[group];
        kept.resize(most, {Vec3(0.0), 1.0});
        for (const SurfaceLines::Kept& half : kept) {
            append(normals, half.normal);
            append(distances, Vec3(half.distance, 0.0, 0.0));
        }
    }
    for (const Vec3& step : lines.to_lights) {
        append(lights, step);
    }
    for (const Vec3& step : lines.around) {
        append(around, step);
    }
    program.set_array3("caster", surfaces.data(), static_cast<int>(surfaces.size() / 3));
    program.set("caster_opaque", static_cast<float>(SurfaceLines::opaque));
    program.set_array3("light_step", lights.data(), static_cast<int>(lines.to_lights.size()));
    program.set_array3("around_step", around.data(), static_cast<int>(lines.around.size()));
    program.set("around_steps", static_cast<float>(lines.around_steps));
    program.set_array3("kept_normal", normals.data(), static_cast<int>(normals.size() / 3));
    program.set_array3("kept_distance", distances.data(), static_cast<int>(distances.size() / 3));
}

} // namespace sheetsplat::backend_gl
