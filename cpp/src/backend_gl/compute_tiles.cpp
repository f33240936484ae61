#include "compute_tiles.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include <glm/geometric.hpp>
#include <glm/matrix.hpp>

#include "base/clock.hpp"
#include "interop.h"
#include "plan/compute_path.hpp"
#include "plan/slab_nodes.hpp"
#include "scene/mode_rules.hpp"
#include "sheetsplat/error.hpp"
#include "splatting.hpp"
#include "view/ellipsoid_view.hpp"

namespace sheetsplat::backend_gl {

namespace {

constexpr double log2_e = 1.4426950408889634;
/// Drivers end programs that run for a second or two: no call is expected to take longer than this.
constexpr double seconds_a_call = 0.1;
/// Steps of four slabs of the first call on a device, and the fewest of any: each sums one step twice.
constexpr double first_steps = 16.0, least_steps = 4.0;

float f(double value) { return static_cast<float>(value); }
std::size_t over(std::size_t count, std::size_t by) { return (count + by - 1) / by; }

template <class Number>
void put(const Vec3& from, Number (&to)[4]) {
    for (int axis = 0; axis < 3; ++axis) {
        to[axis] = static_cast<Number>(from[axis]);
    }
}

} // namespace

/// Part of lib/tile_scene.glsl.
struct alignas(32) ComputeTiles::PartRecord {
    int kind[4]{}, kernels[4]{}, size[4]{};
    float kernel[4]{}, division[4]{}, texels[4]{};
    float frame[3][4]{}, reach[4]{}, unit[4]{}, pace[4]{};
    double start[4]{}, right[4]{}, down[4]{}, back[4]{};
};

ComputeTiles::ComputeTiles(const TileScope& scope, const Classification* classification)
    : scope_(scope), shading_(scope, classification) {
    static_assert(sizeof(PartRecord) == 320, "programs read records of this layout");
}

ComputeTiles::PartRecord ComputeTiles::record_of(std::size_t field) const {
    const Scene& scene = *scope_.job.scene;
    const Kernel& kernel = scene.fields[field]->kernel();
    PartRecord record;
    record.kind[1] = static_cast<int>(group_drawn_of(scene, field));
    record.kind[2] = !scope_.plan.own_sheets.empty() && scope_.plan.own_sheets[field] >= 0 ? 1 : 0;
    record.kernel[0] = f(kernel.falloff * log2_e);
    record.kernel[1] = f(kernel.edge());
    record.kernel[2] = f(std::sqrt(kernel.falloff));
    const TileScope::Division division = scope_.division_of(field);
    record.division[0] = division.w0;
    record.division[1] = division.pivot;
    record.division[2] = division.half_range;
    record.division[3] = division.least_weight;
    return record;
}

ComputeTiles::PartRecord ComputeTiles::lattice_record(const RegularPart& part, int number) {
    const ResidentLattice& resident = scope_.resources.fields().lattice(*scope_.job.scene, part);
    lattices_.push_back(&resident);
    holes_ = holes_ || resident.holes;
    const FieldView& view = *part.view;
    const Frame& frame = scope_.frame;
    const Counting& counting = scope_.counting[part.field];
    PartRecord record = record_of(part.field);
    record.kind[0] = 1;
    record.kind[3] = number;
    const auto& shape = view.field->shape();
    for (std::size_t axis = 0; axis < 3; ++axis) {
        record.size[axis] = static_cast<int>(shape[2 - axis]);
    }
    record.kernel[3] = f(view.weight_scale);
    record.texels[0] = f(resident.unit);
    record.texels[1] = f(resident.added - counting.pivot);
    record.texels[2] = f(view.field->options().radius);
    record.texels[3] = f(counting.half_range > 0.0 ? view.weight_scale / counting.half_range : view.value_scale);
    const Mat3 samples = glm::inverse(Mat3(view.step_i, view.step_j, view.step_k));
    const LatticeReach reach = lattice_reach(view);
    for (int row = 0; row < 3; ++row) {
        put(reach.frame[row], record.frame[row]);
    }
    put(reach.samples, record.reach);
    const bool bcc = view.field->lattice() == Lattice::bcc;
    record.reach[3] = bcc ? 1.0F : 0.0F;
    record.unit[0] = f(view.to_unit[0].x * frame.pixel);
    record.unit[1] = f(view.to_unit[0].y * frame.pixel);
    record.unit[2] = f(-view.to_unit[1].x * frame.pixel);
    record.unit[3] = f(-view.to_unit[1].y * frame.pixel);
    const Vec3 steps(glm::length(view.field->steps()[0]), glm::length(view.field->steps()[1]),
                     glm::length(view.field->steps()[2]));
    put(bcc ? steps / view.field->kernel_axes().lengths.x : Vec3(1.0 / view.field->options().radius), record.pace);
    const bool perspective = frame.projection == Projection::perspective;
    const Vec3 corner = perspective
                            ? Vec3(0.0)
                            : Vec3(-scope_.axis_x() * frame.pixel, scope_.axis_y() * frame.pixel, -frame.first_depth);
    put(samples * (corner - view.first_eye), record.start);
    put(samples * Vec3(frame.pixel, 0.0, 0.0), record.right);
    put(samples * Vec3(0.0, -frame.pixel, 0.0), record.down);
    put(samples * Vec3(0.0, 0.0, perspective ? -1.0 : -frame.slice_spacing), record.back);
    drawn_ += part.runs->samples();
    return record;
}

ComputeTiles::PartRecord ComputeTiles::kernels_record(const EllipsoidPart& part) {
    const ResidentKernels& resident = scope_.resources.fields().kernels(*scope_.job.scene, part);
    PartRecord record = record_of(part.field);
    const std::size_t count = resident.order.size();
    const std::size_t leaves = over(count, TREE_ARITY), nodes = over(leaves, TREE_ARITY);
    record.kernels[0] = static_cast<int>(records_);
    record.kernels[1] = static_cast<int>(ordered_);
    record.kernels[2] = static_cast<int>(count);
    record.kernels[3] = static_cast<int>(leaves_);
    record.size[0] = static_cast<int>(leaves);
    record.size[1] = static_cast<int>(nodes);
    records_ += part.kernels->size();
    ordered_ += count;
    leaves_ += leaves + nodes;
    drawn_ += count;
    return record;
}

double ComputeTiles::prepare() {
    const Job& job = scope_.job;
    Resources& resources = scope_.resources;
    resources.fields().keep(job.scene->fields);
    // Fields are added in the order of the scene.
    std::vector<PartRecord> parts;
    auto lattice = job.regular.begin();
    auto scattered = job.ellipsoids.begin();
    while (lattice != job.regular.end() || scattered != job.ellipsoids.end()) {
        if (scattered == job.ellipsoids.end() || (lattice != job.regular.end() && lattice->field < scattered->field)) {
            parts.push_back(lattice_record(*lattice++, static_cast<int>(lattices_.size())));
        } else {
            parts.push_back(kernels_record(*scattered++));
        }
    }
    parts_ = parts.size();
    if (!job.ellipsoids.empty()) {
        resources.fields().upload_order(*job.scene, job.ellipsoids, resources.order);
        std::vector<const EllipsoidField*> fields;
        for (const EllipsoidPart& part : job.ellipsoids) {
            fields.push_back(part.kernels.get());
        }
        resources.section_pass().keep(fields);
        slice_kernels();
        static_cast<void>(resources.bounds.map(std::max<std::size_t>(leaves_, 1) * 8 * sizeof(float)));
        resources.bounds.unmap();
    }
    resources.parts.upload(parts.data(), std::max<std::size_t>(parts.size(), 1) * sizeof(PartRecord));
    resources.parts.bind_storage(BUFFER_PARTS);
    resources.sections.bind_storage(BUFFER_RECORDS);
    resources.order.bind_storage(BUFFER_ORDER);
    resources.bounds.bind_storage(BUFFER_BOUNDS);
    find_bounds(parts);
    double turns = 0.0;
    for (const PartRecord& part : parts) {
        turns += turns_of(part);
    }
    return turns;
}

double ComputeTiles::turns_of(const PartRecord& part) const {
    if (part.kind[0] == 0) {
        return static_cast<double>(part.kernels[2]) + part.size[0] + part.size[1];
    }
    // The samples around the points of a step, at the deepest slice in perspective.
    const Frame& frame = scope_.frame;
    const bool perspective = frame.projection == Projection::perspective;
    const double deepest = perspective ? frame.depth_of(frame.slices) : 1.0;
    double samples = 1.0;
    for (int axis = 0; axis < 3; ++axis) {
        const double slope =
            std::abs(part.right[axis]) * std::max(scope_.axis_x(), scope_.tile.target_width() - scope_.axis_x()) +
            std::abs(part.down[axis]) * std::max(scope_.axis_y(), scope_.tile.target_height() - scope_.axis_y());
        const double step =
            perspective ? frame.slice_spacing * (std::abs(part.back[axis]) + slope) : std::abs(part.back[axis]);
        const double beside = 2.0 * deepest * (std::abs(part.right[axis]) + std::abs(part.down[axis]));
        samples *= 2.0 * static_cast<double>(part.reach[axis]) + 2.0 + (gathers_products() ? 0.0 : 4.0 * step + beside);
    }
    return 1.5 * samples * (gathers_products() ? 4.0 : 1.0);
}

int ComputeTiles::most_steps_a_call(double turns_a_step) const {
    const int most = scope_.capabilities.most_turns;
    if (most == 0) {
        return std::numeric_limits<int>::max();
    }
    // One step of each call is there for the next; shading takes turns too.
    const int steps = static_cast<int>(std::min(turns_of_kernels(most) / std::max(turns_a_step, 1.0), 1e6)) - 1;
    if (steps < 1) {
        throw Unsupported(
            Complaint{"the scene cannot be drawn by compute programs of " + scope_.capabilities.renderer,
                      "about " + std::to_string(std::llround(2.0 * turns_a_step)) + " turns of loops for eight slices",
                      "at most " + std::to_string(std::llround(turns_of_kernels(most))) +
                          ": this driver ends loops after " + std::to_string(most),
                      "use " + option_ref("path", "raster") + ", or leave it out", "path"});
    }
    return steps;
}

bool ComputeTiles::gathers_products() const {
    return scope_.plan.sampling == Sampling::point && !splats_slopes(scope_.plan);
}

void ComputeTiles::slice_kernels() const {
    const Job& job = scope_.job;
    Resources& resources = scope_.resources;
    const bool rests = scope_.plan.precise_sections;
    const std::size_t bytes = record_floats() * sizeof(float);
    auto* records = static_cast<float*>(resources.sections.map(records_ * bytes));
    // The pass on the device knows no filter.
    for (const EllipsoidPart& part : job.ellipsoids) {
        for (std::size_t kernel = 0; scope_.plan.filter && kernel < part.kernels->size(); ++kernel) {
            const EyeKernel seen = part.view->kernel(kernel);
            const std::int64_t anchor = part.view->anchor(seen, 0, scope_.frame.slices - 1);
            SectionRest rest{};
            SectionRecord record =
                part.view->record(kernel, seen, anchor, rests ? &rest : nullptr, scope_.counting[part.field]);
            record.reserved = rests ? 1.0F : 0.0F;
            std::memcpy(records, &record, sizeof record);
            if (rests) {
                std::memcpy(records + sizeof record / sizeof(float), &rest, sizeof rest);
            }
            records += record_floats();
        }
    }
    resources.sections.unmap();
    std::size_t first = 0;
    for (const EllipsoidPart& part : job.ellipsoids) {
        if (!scope_.plan.filter) {
            resources.section_pass().slice(part.kernels, *part.view, scope_.counting[part.field], resources.sections,
                                           first, rests);
        }
        first += part.kernels->size();
    }
}

std::size_t ComputeTiles::record_floats() const {
    return (sizeof(SectionRecord) + (scope_.plan.precise_sections ? sizeof(SectionRest) : 0)) / sizeof(float);
}

void ComputeTiles::set_reach(const gl::Program& program) const {
    const DrawPlan& plan = scope_.plan;
    program.set("slab_reach", f((plan.sampling == Sampling::slab ? 0.5 : 0.0) + (plan.fine_gradient ? 1.0 : 0.0)));
    program.set("margin", f(sprite_margin(scope_.capabilities) + (plan.fine_gradient ? 1.5 : 0.0)));
}

void ComputeTiles::find_bounds(const std::vector<PartRecord>& parts) const {
    if (leaves_ == 0) {
        return;
    }
    const gl::Api& gl = scope_.gl;
    gl::Defines defines{{"RECORD_SIZE", std::to_string(record_floats() / 4)}};
    if (scope_.plan.projection == Projection::perspective) {
        defines["PERSPECTIVE"] = "1";
    }
    const gl::Program& program = scope_.resources.compute_program("bounds.comp", defines);
    program.use();
    program.set("axis", f(scope_.axis_x()), f(scope_.axis_y()));
    program.set("first_depth", f(scope_.frame.first_depth));
    program.set("slice_spacing", f(scope_.frame.slice_spacing));
    program.set("last_slab", f(static_cast<double>(scope_.frame.slices - 1)));
    set_reach(program);
    gl.MemoryBarrier(GL_TRANSFORM_FEEDBACK_BARRIER_BIT | GL_SHADER_STORAGE_BARRIER_BIT);
    for (const int leaves : {1, 0}) {
        program.set("leaves", leaves);
        for (std::size_t part = 0; part < parts.size(); ++part) {
            const auto groups = static_cast<std::size_t>(parts[part].size[leaves != 0 ? 0 : 1]);
            if (parts[part].kind[0] == 0 && groups > 0) {
                program.set("part", static_cast<int>(part));
                constexpr std::size_t most_across = 32768;
                gl.DispatchCompute(static_cast<GLuint>(std::min(groups, most_across)),
                                   static_cast<GLuint>(over(groups, most_across)), 1);
            }
        }
        gl.MemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT);
    }
}

TileProgram ComputeTiles::program() const {
    const DrawPlan& plan = scope_.plan;
    const Scene& scene = *scope_.job.scene;
    TileProgram made;
    gl::Defines& defines = made.defines;
    defines = shade_defines(plan, shaded_parts(scene), 0, line_counts(plan, scene));
    const ComputeShape shape = compute_shape(plan, scene);
    made.edge = shape.edge(scope_.capabilities);
    made.border = shape.border;
    const auto set = [&](const char* name, int value) { defines[name] = std::to_string(value); };
    set("COMPUTE", 1);
    set("EDGE", made.edge);
    set("BORDER", made.border);
    set("PARTS", static_cast<int>(parts_));
    set("PLANES", shape.planes);
    int plane = 0;
    set("PLANE_VALUE", plane++);
    if (plan.weight) {
        set("PLANE_WEIGHT", plane++);
    }
    set("PLANE_SLOPES", plane);
    set("PLANE_WEIGHT_SLOPES", plane + 3);
    if (!lattices_.empty()) {
        set("LATTICES", static_cast<int>(lattices_.size()));
    }
    const auto switch_on = [&](const char* name, bool on) {
        if (on) {
            set(name, 1);
        }
    };
    switch_on("ELLIPSOIDS", !scope_.job.ellipsoids.empty());
    switch_on("PRECISE_PLACES", plan.precise_sections);
    set("RECORD_SIZE", static_cast<int>(record_floats() / 4));
    switch_on("HOLES", holes_);
    switch_on("COUNTING", scope_.hooks.counts_work());
    switch_on("DIVIDED", shape.divided);
    switch_on("WEIGHT_ALONE", shape.divided);
    switch_on("SLAB", plan.sampling == Sampling::slab);
    switch_on("FINE", splats_slopes(plan));
    switch_on("PRODUCTS", gathers_products());
    defines["FOUR_NODE_SLAB"] = std::to_string(four_node_slab);
    defines["SIX_NODE_SLAB"] = std::to_string(six_node_slab);
    return made;
}

void ComputeTiles::clear_counts(std::size_t groups) {
    const std::vector<std::uint32_t> zeros(4 * groups);
    scope_.resources.counts.upload(zeros.data(), zeros.size() * sizeof(std::uint32_t));
    scope_.resources.counts.bind_storage(BUFFER_COUNTS);
}

void ComputeTiles::add_counts(std::size_t groups) {
    scope_.gl.MemoryBarrier(GL_BUFFER_UPDATE_BARRIER_BIT);
    std::vector<std::uint32_t> numbers(4 * groups);
    scope_.resources.counts.read(numbers.data(), numbers.size() * sizeof(std::uint32_t));
    for (std::size_t group = 0; group < groups; ++group) {
        for (std::size_t n = 0; n < counts_.size(); ++n) {
            counts_[n] += numbers[4 * group + n];
        }
    }
}

void ComputeTiles::run(const std::function<void(double)>& progress) {
    const gl::Api& gl = scope_.gl;
    const Frame& frame = scope_.frame;
    const Tile& tile = scope_.tile;
    start_picture(scope_);
    if (frame.slices == 0) {
        return;
    }
    const double turns_a_step = prepare();
    const TileProgram how = program();
    const gl::Program& program = scope_.resources.compute_program("tile.comp", how.defines);
    program.use();
    // Of a pass that begins at slab 0: the program counts on from there.
    shading_.bind_inputs(program, 1);
    program.set("axis_px", f(scope_.axis_x()), f(scope_.axis_y()));
    program.set("first_depth", f(frame.first_depth));
    program.set("depth_of_first", frame.first_depth);
    program.set("exact_spacing", frame.slice_spacing);
    program.set("slice_spacing", f(frame.slice_spacing));
    program.set("last_slab_of_all", static_cast<int>(frame.slices - 1));
    program.set("picture_size", tile.width, tile.height);
    set_reach(program);
    for (std::size_t number = 0; number < lattices_.size(); ++number) {
        const std::string element = "[" + std::to_string(number) + "]";
        const int unit = UNIT_LATTICES + 2 * static_cast<int>(number);
        lattices_[number]->samples.bind(unit);
        lattices_[number]->blocks.bind(unit + 1);
        program.set("lattice_textures" + element, unit);
        program.set("block_textures" + element, unit + 1);
    }
    shared_bytes_ = compute_shape(scope_.plan, *scope_.job.scene).bytes(how.edge);
    threads_ = how.edge * how.edge;
    scope_.targets.bind_images();
    gl.MemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT | GL_SHADER_IMAGE_ACCESS_BARRIER_BIT);
    const int core = how.edge - 2 * how.border;
    const int across = (tile.width + core - 1) / core;
    const int down = (tile.height + core - 1) / core;
    const int most_steps = most_steps_a_call(turns_a_step);
    // As much a call as the time of the one before allows: rows of tiles, or of one row some of its steps.
    const auto steps = static_cast<int>(scope_.steps.passes);
    double& seconds = scope_.resources.seconds_a_step;
    const bool counting = scope_.hooks.counts_work();
    for (int row = 0; row < down;) {
        const double in_time = seconds > 0.0 ? seconds_a_call / (seconds * across) : first_steps;
        const int rows = static_cast<int>(std::clamp(in_time / steps, 1.0, static_cast<double>(down - row)));
        int at_once = static_cast<int>(std::clamp(in_time / rows, least_steps, static_cast<double>(steps)));
        at_once = std::min(at_once, most_steps);
        program.set("first_tile", 0, row);
        if (counting) {
            clear_counts(static_cast<std::size_t>(across) * static_cast<std::size_t>(rows));
        }
        for (int step = 0; step < steps; step += at_once) {
            const auto started = Clock::now();
            program.set("steps", step, std::min(step + at_once, steps));
            gl.DispatchCompute(static_cast<GLuint>(across), static_cast<GLuint>(rows), 1);
            gl.MemoryBarrier(GL_SHADER_IMAGE_ACCESS_BARRIER_BIT);
            if (row + rows < down || step + at_once < steps || seconds == 0.0) {
                gl.Finish();
                seconds =
                    seconds_since(started) / (static_cast<double>(across) * rows * std::min(at_once, steps - step));
            }
            progress((row + static_cast<double>(rows) * std::min(step + at_once, steps) / steps) / down);
        }
        if (counting) {
            add_counts(static_cast<std::size_t>(across) * static_cast<std::size_t>(rows));
        }
        row += rows;
    }
    gl.MemoryBarrier(GL_FRAMEBUFFER_BARRIER_BIT | GL_TEXTURE_UPDATE_BARRIER_BIT);
    gl::check_errors(gl, "computing tiles");
}

} // namespace sheetsplat::backend_gl
