#include "preshaded.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include <glm/geometric.hpp>

#include "interop.h"
#include "lab_interop.h"
#include "sheetsplat/error.hpp"
#include "tile_marks.hpp"

namespace sheetsplat::lab {

namespace {

using backend_gl::Job;
using backend_gl::Rectangle;
using backend_gl::RegularPart;
using backend_gl::Resources;
using backend_gl::Targets;
using backend_gl::TargetShape;

constexpr double log2_e = 1.4426950408889634;

/// Colours of samples: the transfer function at the sample's value, lit by the central difference of its neighbours.
class SampleColors {
  public:
    explicit SampleColors(const Job& job, const FieldView& view)
        : scene_(*job.scene), camera_(*job.camera), field_(*view.field) {
        exponent_ = job.frame->slice_spacing / job.frame->reference_length;
        share_ = field_.kernel().gain() /
                 (field_.normalization() == Normalization::lattice ? field_.lattice_constant() : 1.0);
        for (const Light& light : scene_.lights) {
            const Vec3 unit = light.direction / glm::length(light.direction);
            lights_.push_back(light.space == LightSpace::world ? camera_.direction_to_eye(unit) : unit);
        }
    }

    [[nodiscard]] std::array<float, 4> at(std::uint32_t sample) const {
        const auto& shape = field_.shape();
        const std::size_t i = sample % shape[2];
        const std::size_t j = sample / shape[2] % shape[1];
        const std::size_t k = sample / shape[2] / shape[1];
        const TransferPoint point = scene_.transfer_function.at(field_.value(i, j, k));
        const double alpha = point.opacity >= 1.0 ? 1.0 : -std::expm1(exponent_ * std::log1p(-point.opacity));
        const Vec3 color = lights_.empty() ? point.color : lit(point.color, gradient(i, j, k));
        return {static_cast<float>(color.x * alpha * share_), static_cast<float>(color.y * alpha * share_),
                static_cast<float>(color.z * alpha * share_), static_cast<float>(alpha * share_)};
    }

  private:
    [[nodiscard]] double value_or_zero(std::size_t i, std::size_t j, std::size_t k) const {
        const auto& shape = field_.shape();
        const double value = i < shape[2] && j < shape[1] && k < shape[0] ? field_.value(i, j, k) : 0.0;
        return std::isnan(value) ? 0.0 : value;
    }

    [[nodiscard]] Vec3 gradient(std::size_t i, std::size_t j, std::size_t k) const {
        const Vec3 spacing = field_.options().spacing;
        // One below 0 wraps to a number beyond every shape: outside, so 0.
        const Vec3 world((value_or_zero(i + 1, j, k) - value_or_zero(i - 1, j, k)) / (2.0 * spacing.x),
                         (value_or_zero(i, j + 1, k) - value_or_zero(i, j - 1, k)) / (2.0 * spacing.y),
                         (value_or_zero(i, j, k + 1) - value_or_zero(i, j, k - 1)) / (2.0 * spacing.z));
        return camera_.direction_to_eye(world);
    }

    [[nodiscard]] Vec3 lit(const Vec3& color, const Vec3& slope) const {
        const Material& material = scene_.material;
        const double size = glm::length(slope);
        const double weakest =
            1e-3 * (scene_.transfer_function.v_max() - scene_.transfer_function.v_min()) / scene_.reference_distance();
        const Vec3 normal = size > 0.0 ? -slope / std::max(size, weakest) : Vec3(0.0);
        Vec3 result = color * material.ambient;
        for (std::size_t l = 0; l < lights_.size(); ++l) {
            Vec3 side = normal;
            double facing = glm::dot(normal, lights_[l]);
            if (material.two_sided && facing < 0.0) {
                side = -side;
                facing = -facing;
            }
            if (facing > 0.0) {
                const Vec3 mirrored = 2.0 * facing * side - lights_[l];
                const Vec3 glow = color * material.diffuse +
                                  Vec3(material.specular * std::pow(std::max(mirrored.z, 0.0), material.shininess));
                result += scene_.lights[l].color * facing * glow;
            }
        }
        return result;
    }

    const Scene& scene_;
    const Camera& camera_;
    const RegularField& field_;
    double exponent_ = 1.0, share_ = 1.0;
    std::vector<Vec3> lights_;
};

} // namespace

void adjust_for_preshaded(DrawPlan& plan, const Scene& scene) {
    bool drawable = plan.mode == Mode::composite && plan.projection == Projection::orthographic &&
                    plan.sampling == Sampling::point && !plan.general;
    for (const auto& field : scene.fields) {
        const RegularField* regular = as_regular(field.get());
        drawable = drawable && regular != nullptr && regular->lattice() == Lattice::cartesian;
    }
    const bool beyond_papers = plan.coverage || plan.depth || plan.preintegration || plan.clip || plan.filter ||
                               plan.gradient_opacity || plan.cut_faces || plan.depth_cue || plan.analytic_gradient ||
                               plan.shadows || plan.ambient_occlusion;
    if (!drawable || beyond_papers) {
        throw Unsupported(Complaint{"comparator preshaded cannot draw the scene",
                                    "something else than Cartesian volumes as the papers draw them",
                                    "Cartesian volumes in mode composite, orthographic, sampling \"point\", no further "
                                    "outputs and no effects beyond the papers",
                                    "draw such a scene"});
    }
    plan.packing = Packing::paper;
    plan.tagging = Tagging::off;
}

const Targets& draw_preshaded(const Job& job, const gl::Api& gl, Resources& resources, const Tile& tile,
                              const std::function<void(double)>& progress, std::size_t& drawn) {
    TargetShape shape;
    shape.width = tile.target_width();
    shape.height = tile.target_height();
    shape.wide = false;
    const Targets& targets = resources.targets(shape);
    const Frame& frame = *job.frame;
    const auto f = [](double value) { return static_cast<float>(value); };
    gl.Viewport(0, 0, tile.target_width(), tile.target_height());
    gl.Disable(GL_DEPTH_TEST);
    gl.Enable(GL_BLEND);
    targets.clear_all();
    const Rectangle inside{f(Tile::border), f(Tile::border), f(Tile::border + tile.width),
                           f(Tile::border + tile.height)};
    gl::Buffer colors(gl, GL_ARRAY_BUFFER);
    std::vector<SampleColors> shaders;
    std::vector<VertexMaker> makers;
    for (const RegularPart& part : job.regular) {
        const FieldView& view = *part.view;
        shaders.emplace_back(job, view);
        makers.emplace_back(view, frame, tile, job.layout);
    }
    const gl::Program& splat = resources.program({"preshaded.vert", "preshaded.frag", {}, {"sheet_front"}});
    const gl::Program& composite = resources.program({"rectangle.vert", "preshaded_composite.frag", {}, {"image_out"}});
    std::vector<std::array<float, 4>> batch_colors;
    for (std::int64_t slice = 0; slice < frame.slices; ++slice) {
        bool any = false;
        for (std::size_t n = 0; n < makers.size(); ++n) {
            const SlabBatches& batches = *job.regular[n].batches;
            const std::size_t count = batches.count(static_cast<std::size_t>(slice));
            if (count == 0) {
                continue;
            }
            batch_colors.clear();
            auto* vertices = static_cast<SplatVertex*>(resources.samples.map(count * sizeof(SplatVertex)));
            const std::size_t made = makers[n].make(batches.begin(static_cast<std::size_t>(slice)), count, slice,
                                                    vertices, nullptr, [&](const PixelBox&, std::uint32_t sample) {
                                                        const auto color = shaders[n].at(sample);
                                                        if (color[3] == 0.0F) {
                                                            return false;
                                                        }
                                                        batch_colors.push_back(color);
                                                        return true;
                                                    });
            resources.samples.unmap();
            if (made == 0) {
                continue;
            }
            any = true;
            drawn += made;
            colors.upload(batch_colors.data(), batch_colors.size() * sizeof(batch_colors[0]));
            const FieldView& view = *job.regular[n].view;
            targets.bind_splat(-1, 0, 0, false, false);
            gl.BlendFunc(GL_ONE, GL_ONE);
            splat.use();
            splat.set("falloff_log2", f(view.field->kernel().falloff * log2_e));
            splat.set("edge", f(view.field->kernel().edge()));
            splat.set("target_size", f(tile.target_width()), f(tile.target_height()));
            splat.set("half_size", f(makers[n].half_x()), f(makers[n].half_y()));
            splat.set_matrix2("to_unit", f(view.to_unit[0].x * frame.pixel), f(view.to_unit[0].y * frame.pixel),
                              f(-view.to_unit[1].x * frame.pixel), f(-view.to_unit[1].y * frame.pixel));
            resources.splat_array.bind();
            const auto attribute = [&](GLuint location, const gl::Buffer& buffer, GLsizei stride) {
                buffer.bind();
                gl.EnableVertexAttribArray(location);
                gl.VertexAttribPointer(location, 4, GL_FLOAT, GL_FALSE, stride, nullptr);
                gl.VertexAttribDivisor(location, 1);
            };
            gl.DisableVertexAttribArray(ATTRIBUTE_BOX);
            attribute(ATTRIBUTE_SAMPLE, resources.samples, sizeof(SplatVertex));
            attribute(ATTRIBUTE_COLOR, colors, 4 * sizeof(float));
            gl.DrawArraysInstanced(GL_TRIANGLE_STRIP, 0, 4, static_cast<GLsizei>(made));
            gl.DisableVertexAttribArray(ATTRIBUTE_COLOR);
        }
        if (any) {
            targets.bind_image();
            gl.BlendFunc(GL_ONE_MINUS_DST_ALPHA, GL_ONE);
            composite.use();
            targets.sheet(0).value.bind(UNIT_SHEET_FRONT);
            composite.set("sheet_front_texture", UNIT_SHEET_FRONT);
            composite.set("target_size", f(tile.target_width()), f(tile.target_height()));
            composite.set("tag", 0.0F);
            resources.rectangles.upload(&inside, sizeof(inside));
            resources.rectangle_array.bind();
            resources.rectangles.bind();
            gl.EnableVertexAttribArray(ATTRIBUTE_RECTANGLE);
            gl.VertexAttribPointer(ATTRIBUTE_RECTANGLE, 4, GL_FLOAT, GL_FALSE, 0, nullptr);
            gl.VertexAttribDivisor(ATTRIBUTE_RECTANGLE, 1);
            gl.DrawArraysInstanced(GL_TRIANGLE_STRIP, 0, 4, 1);
            targets.clear_sheet(0);
        }
        progress(static_cast<double>(slice + 1) / static_cast<double>(frame.slices));
    }
    return targets;
}

} // namespace sheetsplat::lab
