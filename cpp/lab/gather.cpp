#include "gather.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "base/memory.hpp"
#include "interop.h"
#include "lab_interop.h"
#include "sheetsplat/error.hpp"

namespace sheetsplat::lab {

namespace {

constexpr double log2_e = 1.4426950408889634;
constexpr double most_cells = 1 << 21;
constexpr double most_entries = 1 << 24;
/// Entries that are worth shorter lists, a kernel.
constexpr double entries_a_kernel = 64.0;
/// By so much of its edge a cell counts as larger: a pixel's place in it is a float32.
constexpr double cell_margin = 2e-4;
/// One record serves all slices of a kernel: at 1:10,000 the 99.9th percentile was seen at 7e-5.
constexpr double largest_aspect = 16384.0;
/// Places that pixels know in float32; seen at 1e8 to be right, at 1e9 1e-2 off.
constexpr double largest_px = 1e7, smallest_px = 1e-2;
constexpr const char* name = "the grid of lists that pixels look into";
constexpr const char* next = "use fewer kernels at a time";

float f(double value) { return static_cast<float>(value); }

/// Whether an ellipsoid's support can meet a cube; now and then it says so of one that is near.
class SupportTest {
  public:
    SupportTest(const Mat3& shape, const Vec3& axes, const Vec3& center, double edge) : center_(center) {
        for (int own = 0; own < 3; ++own) {
            inverse_[own] = shape[own] / axes[own] / axes[own];
        }
        for (int world = 0; world < 3; ++world) {
            const double half = 0.5 * edge * (1.0 + 2.0 * cell_margin);
            half_edges_[world] = half * Vec3(inverse_[0][world], inverse_[1][world], inverse_[2][world]);
        }
    }

    /// In the unit sphere's space the cube is a slanted box: a plane across the way to its middle may part the two.
    [[nodiscard]] bool meets(const Vec3& middle) const {
        const Vec3 from = middle - center_;
        const Vec3 at(glm::dot(inverse_[0], from), glm::dot(inverse_[1], from), glm::dot(inverse_[2], from));
        const double away = glm::length(at);
        if (away <= 1.0) {
            return true;
        }
        double nearer = 0.0;
        for (int world = 0; world < 3; ++world) {
            nearer += std::abs(glm::dot(half_edges_[world], at));
        }
        return away - nearer / away <= 1.0;
    }

  private:
    Vec3 center_;
    Vec3 inverse_[3];
    Vec3 half_edges_[3];
};

/// Cells along each axis that a kernel's box meets.
struct Reach {
    std::array<int, 3> low, high;

    Reach(const Vec3& lower, double edge, const std::array<int, 3>& shape, const Vec3& center, const Vec3& extent) {
        for (int axis = 0; axis < 3; ++axis) {
            const auto a = static_cast<std::size_t>(axis);
            const auto cell = [&](double at) {
                return static_cast<int>(std::clamp(std::floor((at - lower[axis]) / edge), 0.0, shape[a] - 1.0));
            };
            low[a] = cell(center[axis] - extent[axis] - cell_margin * edge);
            high[a] = cell(center[axis] + extent[axis] + cell_margin * edge);
        }
    }

    [[nodiscard]] double cells() const {
        return (high[0] - low[0] + 1.0) * (high[1] - low[1] + 1.0) * (high[2] - low[2] + 1.0);
    }
};

void refuse(const std::string& found) {
    throw Unsupported(Complaint{"comparator gather cannot draw the scene", found,
                                "one field of ellipsoids in orthographic view, sampling \"point\", "
                                "without a filter, packing wide",
                                "draw such a scene"});
}

std::size_t padded(std::size_t texels) {
    return std::max<std::size_t>((texels + KERNEL_COLUMNS - 1) / KERNEL_COLUMNS, 1) * KERNEL_COLUMNS;
}

gl::Texture uploaded(const gl::Api& gl, GLenum internal, GLenum format, GLenum type, std::size_t texels,
                     const void* data) {
    gl::Texture texture(gl, internal, KERNEL_COLUMNS, static_cast<int>(texels / KERNEL_COLUMNS));
    texture.upload(format, type, data);
    return texture;
}

} // namespace

ReachGrid ReachGrid::of(const EllipsoidField& field, const std::vector<std::uint32_t>& kernels) {
    ReachGrid grid;
    if (kernels.empty()) {
        return grid;
    }
    constexpr double infinity = std::numeric_limits<double>::infinity();
    Vec3 upper(-infinity);
    grid.lower = Vec3(infinity);
    for (const std::uint32_t kernel : kernels) {
        grid.lower = glm::min(grid.lower, field.center(kernel) - field.extent(kernel));
        upper = glm::max(upper, field.center(kernel) + field.extent(kernel));
    }
    const Vec3 size = upper - grid.lower;
    const double largest = std::max({size.x, size.y, size.z});
    double filled = 0.0;
    for (const std::uint32_t kernel : kernels) {
        const Vec3 share = 2.0 * field.extent(kernel) / largest;
        filled += share.x * share.y * share.z;
    }
    const auto count = static_cast<double>(kernels.size());
    const double most = std::min(entries_a_kernel * count + 1024.0, most_entries);
    for (grid.edge = 0.5 * largest * std::cbrt(filled / count);; grid.edge *= 1.2) {
        const Vec3 cells = glm::max(glm::ceil(size / grid.edge), 1.0);
        if (!(cells.x * cells.y * cells.z <= most_cells)) {
            continue;
        }
        grid.shape = {static_cast<int>(cells.x), static_cast<int>(cells.y), static_cast<int>(cells.z)};
        double listed = 0.0;
        for (const std::uint32_t kernel : kernels) {
            listed += Reach(grid.lower, grid.edge, grid.shape, field.center(kernel), field.extent(kernel)).cells();
        }
        if (listed <= most) {
            require_memory(static_cast<std::uint64_t>(listed) * 12 +
                               static_cast<std::uint64_t>(cells.x * cells.y * cells.z) * 8,
                           name, next);
            break;
        }
    }
    struct Found {
        std::uint32_t cell, kernel;
    };
    std::vector<Found> found;
    grid.lists.assign(static_cast<std::size_t>(grid.shape[0]) * static_cast<std::size_t>(grid.shape[1]) *
                          static_cast<std::size_t>(grid.shape[2]),
                      {0U, 0U});
    for (std::size_t at = 0; at < kernels.size(); ++at) {
        const std::uint32_t kernel = kernels[at];
        const Reach reach(grid.lower, grid.edge, grid.shape, field.center(kernel), field.extent(kernel));
        const SupportTest test(field.shape(kernel), field.semi_axes(kernel), field.center(kernel), grid.edge);
        for (int z = reach.low[2]; z <= reach.high[2]; ++z) {
            for (int y = reach.low[1]; y <= reach.high[1]; ++y) {
                for (int x = reach.low[0]; x <= reach.high[0]; ++x) {
                    if (test.meets(grid.lower + grid.edge * Vec3(x + 0.5, y + 0.5, z + 0.5))) {
                        const auto cell = static_cast<std::uint32_t>((z * grid.shape[1] + y) * grid.shape[0] + x);
                        found.push_back({cell, static_cast<std::uint32_t>(at)});
                        ++grid.lists[cell][1];
                    }
                }
            }
        }
    }
    std::uint32_t sum = 0;
    for (auto& list : grid.lists) {
        list[0] = sum;
        sum += list[1];
        list[1] = 0;
    }
    grid.entries.resize(found.size());
    for (const Found& one : found) {
        auto& list = grid.lists[one.cell];
        grid.entries[list[0] + list[1]++] = one.kernel;
    }
    return grid;
}

namespace {

/// The sheets that the one field is summed in.
int own_sheets(const DrawPlan& plan) { return plan.own_sheets.empty() ? -1 : plan.own_sheets.front(); }
bool has_weights(const DrawPlan& plan) { return plan.weight || own_sheets(plan) >= 0; }

} // namespace

Gather::Gather(const gl::Api& gl, const EllipsoidView& view, const CellTraversal& traversal, const Counting& counting) {
    const EllipsoidField& field = view.field();
    const Frame& frame = view.frame();
    if (field.scale_range()[1] > largest_px * frame.pixel || field.scale_range()[0] < smallest_px * frame.pixel) {
        refuse("kernels of less than " + std::to_string(smallest_px) + " or more than " + std::to_string(largest_px) +
               " pixels");
    }
    std::vector<std::uint32_t> kernels(traversal.kernels());
    for (std::size_t e = 0; e < kernels.size(); ++e) {
        kernels[e] = traversal.entries()[e].kernel;
    }
    ReachGrid grid = ReachGrid::of(field, kernels);
    lower_ = grid.lower;
    edge_ = grid.edge;
    shape_ = grid.shape;

    constexpr std::size_t texels_a_kernel = 4;
    const std::size_t texels = padded(texels_a_kernel * kernels.size());
    require_memory(checked_product(texels, 4 * sizeof(float), name), name, next);
    std::vector<float> records(4 * texels, 0.0F);
    for (std::size_t at = 0; at < kernels.size(); ++at) {
        const EyeKernel kernel = view.kernel(kernels[at]);
        const auto middle = std::round((-kernel.center.z - frame.first_depth) / frame.slice_spacing);
        const SectionRecord record =
            view.record(kernels[at], kernel,
                        static_cast<std::int64_t>(std::clamp(middle, 0.0, static_cast<double>(frame.slices - 1))),
                        nullptr, counting);
        const glm::dvec2 u = glm::dvec2(kernel.axis_u.x, -kernel.axis_u.y) / frame.pixel;
        const glm::dvec2 v = glm::dvec2(kernel.axis_v.x, -kernel.axis_v.y) / frame.pixel;
        const glm::dvec2 to_u = u / glm::length(u) / glm::length(u);
        const glm::dvec2 to_v = v / glm::length(v) / glm::length(v);
        const glm::dvec2 step =
            -frame.slice_spacing / kernel.half_depth * glm::dvec2(kernel.lean.x, -kernel.lean.y) / frame.pixel;
        const std::array<float, 16> numbers{record.whole_x,
                                            record.whole_y,
                                            record.part_x,
                                            record.part_y,
                                            f(to_u.x),
                                            f(to_v.x),
                                            f(to_u.y),
                                            f(to_v.y),
                                            record.s,
                                            record.step_s,
                                            f(glm::dot(to_u, step)),
                                            f(glm::dot(to_v, step)),
                                            record.value,
                                            record.weight,
                                            record.first,
                                            0.0F};
        std::copy(numbers.begin(), numbers.end(), records.begin() + static_cast<std::ptrdiff_t>(16 * at));
    }
    grid.lists.resize(padded(grid.lists.size()), {0U, 0U});
    grid.entries.resize(padded(grid.entries.size()), 0U);
    lists_ = uploaded(gl, GL_RG32UI, GL_RG_INTEGER, GL_UNSIGNED_INT, grid.lists.size(), grid.lists.data());
    entries_ = uploaded(gl, GL_R32UI, GL_RED_INTEGER, GL_UNSIGNED_INT, grid.entries.size(), grid.entries.data());
    records_ = uploaded(gl, GL_RGBA32F, GL_RGBA, GL_FLOAT, texels, records.data());
}

void Gather::splat(backend_gl::Splatting& splatting, std::size_t part, std::int64_t pass) const {
    const backend_gl::TileScope& scope = splatting.scope;
    PixelBox touched{scope.tile.target_width(), scope.tile.target_height(), 0, 0};
    splatting.for_each_active(part, [&](std::size_t, const PixelBox& box) {
        touched = {std::min(touched.x0, box.x0), std::min(touched.y0, box.y0), std::max(touched.x1, box.x1),
                   std::max(touched.y1, box.y1)};
    });
    if (touched.empty()) {
        return;
    }
    splatting.bind_target({own_sheets(scope.plan), has_weights(scope.plan), true, false}, pass);
    use(scope, *scope.job.ellipsoids[part].view, splatting.slab_pass(pass));
    // What is written is finished: nothing adds to it.
    scope.gl.Disable(GL_BLEND);
    scope.draw_rectangles({{f(touched.x0), f(touched.y0), f(touched.x1), f(touched.y1)}});
}

void Gather::use(const backend_gl::TileScope& scope, const EllipsoidView& view,
                 const backend_gl::SlabPass& pass) const {
    backend_gl::ShaderVariant variant{"rectangle.vert", "gather.frag", {}, {"sheet_front"}};
    if (has_weights(scope.plan)) {
        variant.defines["WEIGHT"] = "1";
        variant.outputs.emplace_back("weight_front");
    }
    const gl::Program& program = scope.resources.program(variant);
    program.use();
    const auto bind = [&](const char* texture_name, const gl::Texture& texture, int unit) {
        texture.bind(unit);
        program.set(texture_name, unit);
    };
    bind("list_texture", lists_, UNIT_GATHER_LISTS);
    bind("entry_texture", entries_, UNIT_GATHER_ENTRIES);
    bind("record_texture", records_, UNIT_GATHER_RECORDS);
    const Frame& frame = view.frame();
    const double k = view.field().kernel().falloff;
    const Vec3 corner = view.eye_world() - pass.axis_x * frame.pixel * view.right_world() +
                        pass.axis_y * frame.pixel * view.up_world() -
                        frame.depth_of(pass.first_slab) * view.back_world() - lower_;
    const auto set = [&](const char* uniform, const Vec3& v) {
        program.set(uniform, f(v.x / edge_), f(v.y / edge_), f(v.z / edge_));
    };
    set("cell_corner", corner);
    set("cell_right", frame.pixel * view.right_world());
    set("cell_down", -frame.pixel * view.up_world());
    set("cell_back", -frame.slice_spacing * view.back_world());
    program.set("shape", f(shape_[0]), f(shape_[1]), f(shape_[2]));
    program.set("axis", f(pass.axis_x), f(pass.axis_y));
    program.set("first_slab", f(static_cast<double>(pass.first_slab)));
    program.set("falloff_log2", f(k * log2_e));
    program.set("edge", f(view.field().kernel().edge()));
    program.set("target_size", f(pass.target_width), f(pass.target_height));
    program.set("tag", pass.tag);
}

void adjust_for_gather(DrawPlan& plan, const Scene& scene) {
    const EllipsoidField* field = as_ellipsoids(scene.fields.front().get());
    if (scene.fields.size() != 1) {
        refuse("several fields");
    } else if (field == nullptr) {
        refuse("a scene without scattered ellipsoids");
    } else if (plan.projection == Projection::perspective) {
        refuse("a perspective camera");
    } else if (plan.sampling == Sampling::slab) {
        refuse("slab sampling");
    } else if (plan.filter) {
        refuse("a filter");
    } else if (plan.fine_gradient || plan.analytic_gradient) {
        refuse("differences or derivatives that are splatted");
    } else if (plan.packing == Packing::paper || plan.paper_slicing) {
        refuse("packing paper");
    }
    for (std::size_t kernel = 0; kernel < field->size(); ++kernel) {
        const Vec3 axes = field->semi_axes(kernel);
        if (std::max({axes.x, axes.y, axes.z}) > largest_aspect * std::min({axes.x, axes.y, axes.z})) {
            refuse("an ellipsoid of more than 1:" + std::to_string(static_cast<int>(largest_aspect)));
        }
    }
    plan.resident_sections = false;
    // Splats leave tags in the depth buffer, pixels that look for kernels do not.
    if (plan.tagging == Tagging::depth_bounds || plan.tagging == Tagging::depth_equal) {
        plan.tagging = Tagging::tiles;
    }
}

} // namespace sheetsplat::lab
