#include "resident_fields.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <type_traits>
#include <variant>

#include <glm/geometric.hpp>
#include <glm/matrix.hpp>

#include "interop.h"

namespace sheetsplat::backend_gl {

namespace {

/// Texels that are converted at once: 64 MiB of float32.
constexpr std::size_t texels_at_once = std::size_t{1} << 24;

/// How samples of a type become texels.
template <class Sample>
struct Texels;
template <>
struct Texels<std::uint8_t> {
    using Type = std::uint8_t;
    static constexpr GLenum format = GL_R8;
    static constexpr double unit = 255.0, least = 0.0;
};
template <>
struct Texels<std::uint16_t> {
    using Type = std::uint16_t;
    static constexpr GLenum format = GL_R16;
    static constexpr double unit = 65535.0, least = 0.0;
};
template <>
struct Texels<std::int16_t> {
    using Type = std::uint16_t;
    static constexpr GLenum format = GL_R16;
    static constexpr double unit = 65535.0, least = -32768.0;
};

/// write(row of texels, j, k) of each row, and uploads layers.
template <class Texel, class Write>
gl::VolumeTexture make_volume(const gl::Api& gl, GLenum format, const std::array<std::size_t, 3>& shape,
                              const Write& write) {
    const auto [nk, nj, ni] = shape;
    gl::VolumeTexture volume(gl, format, static_cast<int>(ni), static_cast<int>(nj), static_cast<int>(nk));
    const std::size_t layers = std::clamp<std::size_t>(texels_at_once / (nj * ni), 1, nk);
    std::vector<Texel> texels(layers * nj * ni);
    for (std::size_t first = 0; first < nk; first += layers) {
        const std::size_t count = std::min(layers, nk - first);
        for (std::size_t k = 0; k < count; ++k) {
            for (std::size_t j = 0; j < nj; ++j) {
                write(texels.data() + (k * nj + j) * ni, j, first + k);
            }
        }
        volume.upload(static_cast<int>(first), static_cast<int>(count), texels.data());
    }
    return volume;
}

bool is_whole(const RegularField& field) {
    const auto [nk, nj, ni] = field.shape();
    for (std::size_t k = 0; k < nk; ++k) {
        for (std::size_t j = 0; j < nj; ++j) {
            const SampleRange range = field.kernels_of_row(j, k);
            if (range.begin != 0 || range.end != ni) {
                return false;
            }
        }
    }
    return true;
}

void fill_samples(const gl::Api& gl, const RegularField& field, ResidentLattice& resident) {
    resident.holes = field.has_holes() || !is_whole(field);
    const double base = field.counted_from();
    const std::size_t ni = field.shape()[2];
    std::visit(
        [&](const auto& data) {
            using Sample = std::remove_const_t<std::remove_reference_t<decltype(data[0])>>;
            if constexpr (std::is_integral_v<Sample>) {
                using Kind = Texels<Sample>;
                if (!resident.holes) {
                    resident.unit = Kind::unit;
                    resident.added = Kind::least - base;
                    resident.samples = make_volume<typename Kind::Type>(
                        gl, Kind::format, field.shape(), [&](auto* row, std::size_t j, std::size_t k) {
                            const std::size_t begin = field.row(j, k);
                            for (std::size_t i = 0; i < ni; ++i) {
                                row[i] = static_cast<typename Kind::Type>(static_cast<int>(data[begin + i]) -
                                                                          static_cast<int>(Kind::least));
                            }
                        });
                    return;
                }
            }
            // Counted from the base in float64: float32 keeps what is left.
            resident.unit = 1.0;
            resident.added = 0.0;
            resident.samples =
                make_volume<float>(gl, GL_R32F, field.shape(), [&](float* row, std::size_t j, std::size_t k) {
                    const std::size_t begin = field.row(j, k);
                    const SampleRange range = field.kernels_of_row(j, k);
                    for (std::size_t i = 0; i < ni; ++i) {
                        row[i] = i >= range.begin && i < range.end
                                     ? static_cast<float>(static_cast<double>(data[begin + i]) - base)
                                     : std::numeric_limits<float>::quiet_NaN();
                    }
                });
        },
        field.samples());
}

/// Marks the blocks of samples in which some point is nearer to a drawn sample than the radius.
void fill_blocks(const gl::Api& gl, const RegularField& field, const VisibleRuns& runs,
                 const std::array<std::size_t, 3>& reach, ResidentLattice& resident) {
    constexpr std::size_t edge = BLOCK_EDGE;
    const auto [nk, nj, ni] = field.shape();
    const std::array<std::size_t, 3> blocks{(nk + edge - 1) / edge, (nj + edge - 1) / edge, (ni + edge - 1) / edge};
    std::vector<std::uint8_t> marks(blocks[0] * blocks[1] * blocks[2]);
    const auto first = [&](std::size_t at, std::size_t axis) { return (at - std::min(at, reach[axis])) / edge; };
    const auto last = [&](std::size_t at, std::size_t axis) {
        return std::min(at + reach[axis], field.shape()[axis] - 1) / edge;
    };
    for (std::size_t k = 0; k < nk; ++k) {
        for (std::size_t j = 0; j < nj; ++j) {
            for (const Run* run = runs.begin(k * nj + j); run != runs.end(k * nj + j); ++run) {
                const std::size_t from = first(run->begin, 2), to = last(run->end - 1, 2);
                for (std::size_t bk = first(k, 0); bk <= last(k, 0); ++bk) {
                    for (std::size_t bj = first(j, 1); bj <= last(j, 1); ++bj) {
                        std::uint8_t* row = marks.data() + (bk * blocks[1] + bj) * blocks[2];
                        std::fill(row + from, row + to + 1, std::uint8_t{1});
                    }
                }
            }
        }
    }
    resident.blocks =
        make_volume<std::uint8_t>(gl, GL_R8UI, blocks, [&](std::uint8_t* row, std::size_t j, std::size_t k) {
            std::copy_n(marks.data() + (k * blocks[1] + j) * blocks[2], blocks[2], row);
        });
}

ResidentFields::Key key_of(const Scene& scene, std::size_t number) {
    const auto field = scene.fields.begin() + static_cast<std::ptrdiff_t>(number);
    return {field->get(), static_cast<std::size_t>(std::count(scene.fields.begin(), field, *field))};
}

template <class Entries>
void drop_others(Entries& entries, const std::vector<std::shared_ptr<const Field>>& fields) {
    for (auto entry = entries.begin(); entry != entries.end();) {
        const bool used = std::find(fields.begin(), fields.end(), entry->second.field) != fields.end();
        entry = used ? std::next(entry) : entries.erase(entry);
    }
}

} // namespace

LatticeReach lattice_reach(const FieldView& view) {
    LatticeReach reach;
    const Vec3 steps[3] = {view.step_i, view.step_j, view.step_k};
    for (int axis = 0; axis < 3; ++axis) {
        const double s = steps[axis].z / view.half_depth;
        const glm::dvec2 place = view.to_unit * glm::dvec2(steps[axis].x, steps[axis].y) - s * view.shear;
        reach.frame[0][axis] = s;
        reach.frame[1][axis] = place.x;
        reach.frame[2][axis] = place.y;
    }
    // Rows of the inverse: a sphere's extents where it is turned back.
    const Mat3 samples = glm::inverse(glm::transpose(Mat3(reach.frame[0], reach.frame[1], reach.frame[2])));
    for (int axis = 0; axis < 3; ++axis) {
        reach.samples[axis] = glm::length(Vec3(samples[0][axis], samples[1][axis], samples[2][axis]));
    }
    return reach;
}

const ResidentLattice& ResidentFields::lattice(const Scene& scene, const RegularPart& part) {
    const std::shared_ptr<const Field>& field = scene.fields[part.field];
    const RegularField& samples = *part.view->field;
    ResidentLattice& resident = lattices_[key_of(scene, part.field)];
    if (!resident.field) {
        fill_samples(*gl_, samples, resident);
        resident.field = field;
    }
    const Vec3 supports = lattice_reach(*part.view).samples;
    // (Odd layers of BCC lattices lie half a sample farther.)
    const auto whole = [&](int axis) { return static_cast<std::size_t>(std::ceil(supports[axis] + 0.5)); };
    const std::array<std::size_t, 3> reach{whole(2), whole(1), whole(0)};
    if (!resident.blocks || resident.version != part.version || resident.reach != reach) {
        fill_blocks(*gl_, samples, *part.runs, reach, resident);
        resident.reach = reach;
        resident.version = part.version;
    }
    return resident;
}

const ResidentKernels& ResidentFields::kernels(const Scene& scene, const EllipsoidPart& part) {
    const std::shared_ptr<const Field>& field = scene.fields[part.field];
    ResidentKernels& resident = kernels_[key_of(scene, part.field)];
    if (!resident.field || resident.version != part.version) {
        resident.order.clear();
        for (const std::uint32_t kernel : part.grid->order()) {
            if ((*part.visible)[kernel] != 0) {
                resident.order.push_back(kernel);
            }
        }
        resident.version = part.version;
        resident.field = field;
    }
    return resident;
}

void ResidentFields::upload_order(const Scene& scene, const std::vector<EllipsoidPart>& parts, gl::Buffer& into) {
    std::vector<std::pair<Key, std::uint64_t>> wanted;
    for (const EllipsoidPart& part : parts) {
        wanted.emplace_back(key_of(scene, part.field), part.version);
    }
    if (wanted == uploaded_ && into.capacity() > 0) {
        return;
    }
    std::vector<std::uint32_t> all;
    for (const EllipsoidPart& part : parts) {
        const std::vector<std::uint32_t>& order = kernels(scene, part).order;
        all.insert(all.end(), order.begin(), order.end());
    }
    all.resize(std::max<std::size_t>(all.size(), 1));
    into.upload(all.data(), all.size() * sizeof(std::uint32_t));
    uploaded_ = std::move(wanted);
}

void ResidentFields::keep(const std::vector<std::shared_ptr<const Field>>& fields) {
    drop_others(lattices_, fields);
    drop_others(kernels_, fields);
}

std::size_t ResidentFields::bytes() const {
    std::size_t sum = 0;
    for (const auto& [key, resident] : lattices_) {
        sum += resident.samples.bytes() + resident.blocks.bytes();
    }
    return sum;
}

} // namespace sheetsplat::backend_gl
