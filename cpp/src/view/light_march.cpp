#include "view/light_march.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <utility>

#include <glm/geometric.hpp>

namespace sheetsplat {

namespace {

/// Rows of rays of a task, and how many of them the next task follows too.
constexpr int band_rows = 32, shared_rows = 3;
/// More than any absorption.
constexpr float boundless = 1e30F;
/// e^-x of more than this is 0.
constexpr float all_gone = 80.0F;

/// e^-x for x >= 0 with a relative error below 1e-6: 2^y for y = -x / ln 2 with y's whole part as exponent, and a
/// Taylor polynomial of the rest. Loops over it become vectors.
inline float left_of(float absorbed) {
    constexpr float per_ln_2 = 1.44269504F;
    const float y = -per_ln_2 * std::min(absorbed, all_gone);
    const auto whole = static_cast<std::int32_t>(y - 0.5F);
    const float t = 0.693147181F * (y - static_cast<float>(whole));
    const float high = (((1.0F / 720.0F) * t + 1.0F / 120.0F) * t + 1.0F / 24.0F) * t + 1.0F / 6.0F;
    const float sum = ((high * t + 0.5F) * t + 1.0F) * t + 1.0F;
    const std::int32_t bits = (whole + 127) * (1 << 23);
    float scale = 0.0F;
    std::memcpy(&scale, &bits, sizeof(scale));
    return scale * sum;
}

/// A place between two elements or rays.
struct Between {
    int whole = 0;
    float part = 0.0F;
};
Between between(double place) {
    const double whole = std::floor(place);
    return {static_cast<int>(whole), static_cast<float>(place - whole)};
}

/// What four numbers in a row count for a place between the two in the middle: Catmull and Rom's cubic, which keeps
/// what lines would smooth.
std::array<float, 4> weights(float part) {
    const float p = part, p2 = p * p, p3 = p2 * p;
    return {-0.5F * p + p2 - 0.5F * p3, 1.0F - 2.5F * p2 + 1.5F * p3, 0.5F * p + 2.0F * p2 - 1.5F * p3,
            0.5F * (p3 - p2)};
}
void mix(const std::array<const float*, 4>& from, float part, std::size_t count, float* out) {
    const auto [w0, w1, w2, w3] = weights(part);
    const float *a = from[0], *b = from[1], *c = from[2], *d = from[3];
    for (std::size_t n = 0; n < count; ++n) {
        out[n] = (w0 * a[n] + w1 * b[n]) + (w2 * c[n] + w3 * d[n]);
    }
}
/// The same along a row, kept between 0 and `most`.
void mix_along(const float* from, float part, std::size_t count, float most, float* out) {
    const auto [w0, w1, w2, w3] = weights(part);
    for (std::size_t n = 0; n < count; ++n) {
        const float sum = (w0 * from[n] + w1 * from[n + 1]) + (w2 * from[n + 2] + w3 * from[n + 3]);
        out[n] = std::min(std::max(sum, 0.0F), most);
    }
}

/// Rays through a grid, plane by plane away from the light. Ray r of an axis across meets plane p at the element's
/// place r - offset(p).
class Rays {
  public:
    /// An axis across the rays.
    struct Axis {
        std::size_t stride = 1; ///< elements of the grid from one to the next
        int elements = 1, rays = 1;
        double first = 0.0, per_plane = 0.0;
        [[nodiscard]] double offset(int plane) const { return first - plane * per_plane; }
    };

    Rays(const LightVolume& grid, const Vec3& towards_light, double slice_spacing) {
        const std::array<std::size_t, 3> strides{1, grid.index(0, 1, 0), grid.index(0, 0, 1)};
        std::array<double, 3> towards{};
        std::size_t along = 2;
        for (std::size_t axis = 0; axis < 3; ++axis) {
            towards[axis] = glm::dot(towards_light, grid.per_step[axis]);
            along = std::abs(towards[axis]) > std::abs(towards[along]) ? axis : along;
        }
        planes_ = grid.counts[along];
        plane_stride_ = strides[along];
        backwards_ = towards[along] > 0.0;
        const double per_plane = std::abs(towards[along]);
        slices_ = 1.0 / (per_plane * slice_spacing);
        for (std::size_t n = 0; n < 2; ++n) {
            const std::size_t axis = n == 0 ? (along == 0 ? 1 : 0) : (along == 2 ? 1 : 2);
            Axis& across = n == 0 ? columns_ : rows_;
            across.stride = strides[axis];
            across.elements = grid.counts[axis];
            across.per_plane = -towards[axis] / per_plane;
            const double shear = (planes_ - 1) * across.per_plane;
            across.first = std::max(0.0, shear) + 1.0;
            across.rays = across.elements + static_cast<int>(std::ceil(std::abs(shear))) + 4;
        }
    }

    [[nodiscard]] int planes() const { return planes_; }
    /// From plane to plane, slice distances.
    [[nodiscard]] float slices() const { return static_cast<float>(slices_); }
    [[nodiscard]] const Axis& columns() const { return columns_; }
    [[nodiscard]] const Axis& rows() const { return rows_; }
    /// The first element of a plane's row.
    [[nodiscard]] std::size_t start(int plane, int row) const {
        return static_cast<std::size_t>(backwards_ ? planes_ - 1 - plane : plane) * plane_stride_ +
               static_cast<std::size_t>(row) * rows_.stride;
    }
    [[nodiscard]] std::size_t bands() const {
        return static_cast<std::size_t>((rows_.rays - shared_rows + band_rows - shared_rows - 1) /
                                        (band_rows - shared_rows));
    }

  private:
    int planes_ = 1;
    std::size_t plane_stride_ = 1;
    bool backwards_ = false;
    double slices_ = 1.0;
    Axis columns_, rows_;
};

/// Which rows of a grid's planes hold anything.
class Filled {
  public:
    Filled(const LightVolume& grid, const Rays& rays) : rows_(static_cast<std::size_t>(rays.rows().elements)) {
        const auto elements = static_cast<std::size_t>(rays.columns().elements);
        filled_.resize(rows_ * static_cast<std::size_t>(rays.planes()));
        for (int plane = 0; plane < rays.planes(); ++plane) {
            for (int row = 0; row < rays.rows().elements; ++row) {
                const float* from = grid.values.data() + rays.start(plane, row);
                bool any = false;
                for (std::size_t n = 0; n < elements && !any; ++n) {
                    any = from[n * rays.columns().stride] != 0.0F;
                }
                filled_[static_cast<std::size_t>(plane) * rows_ + static_cast<std::size_t>(row)] = any ? 1 : 0;
            }
        }
    }
    [[nodiscard]] bool at(int plane, int row) const {
        return row >= 0 && row < static_cast<int>(rows_) &&
               filled_[static_cast<std::size_t>(plane) * rows_ + static_cast<std::size_t>(row)] != 0;
    }

  private:
    std::size_t rows_;
    std::vector<unsigned char> filled_;
};

/// A band of rows of rays, and their way from the elements of a plane to rays and back.
class Band {
  public:
    Band(const LightVolume& grid, const Rays& rays, const Filled& filled, std::size_t number)
        : grid_(grid), rays_(rays), filled_(filled), first_(static_cast<int>(number) * (band_rows - shared_rows)),
          count_(std::min(band_rows, rays.rows().rays - first_)), width_(static_cast<std::size_t>(rays.columns().rays)),
          zeros_(padded(), 0.0F), mixed_(padded()), line_(width_) {
        for (auto& row : read_) {
            row.assign(padded(), 0.0F);
        }
    }

    [[nodiscard]] int rows() const { return count_; }
    [[nodiscard]] std::size_t width() const { return width_; }
    [[nodiscard]] std::size_t elements() const { return static_cast<std::size_t>(rays_.columns().elements); }

    /// Where the plane's columns lie among the rays: element 0 at ray first(), and the rays between elements.
    void enter(int plane) {
        plane_ = plane;
        columns_ = between(rays_.columns().offset(plane));
        rows_ = between(rays_.rows().offset(plane));
    }
    /// The first ray that is between two elements of a row, or beside one, and how many are.
    [[nodiscard]] std::size_t first_ray() const { return static_cast<std::size_t>(columns_.whole); }
    [[nodiscard]] std::size_t ray_count() const { return elements() + 1; }

    /// Absorption at the rays first_ray() ... of a row of the band; null where it is 0.
    const float* absorption(int row) {
        // A ray at r lies between elements r - whole - 1 and r - whole.
        const int upper = first_ + row - rows_.whole - 1;
        if (!filled_.at(plane_, upper) && !filled_.at(plane_, upper + 1)) {
            return nullptr;
        }
        std::array<const float*, 4> around{};
        for (int n = 0; n < 4; ++n) {
            const int number = upper - 1 + n;
            around[static_cast<std::size_t>(n)] =
                filled_.at(plane_, number) ? read(number, read_[static_cast<std::size_t>(n)]) : zeros_.data();
        }
        mix(around, 1.0F - rows_.part, padded(), mixed_.data());
        mix_along(mixed_.data(), 1.0F - columns_.part, ray_count(), boundless, line_.data());
        return line_.data();
    }

    /// Calls put(index of the row's first element, numbers) for the rows of the plane that lie between the rows in the
    /// middle of the band. numbers(row): transmittance at the rays; null: 1 at all.
    template <class Numbers, class Put>
    void put_rows(const Numbers& numbers, const Put& put) {
        for (int row = std::max(0, first_ + 1 - rows_.whole); row < rays_.rows().elements; ++row) {
            const int front = row + rows_.whole - first_;
            if (front + 2 >= count_) {
                break;
            }
            std::array<const float*, 4> around{};
            bool any = false;
            for (int n = 0; n < 4; ++n) {
                const float* from = numbers(front - 1 + n);
                any = any || from != nullptr;
                if (from == nullptr && ones_.empty()) {
                    ones_.assign(width_, 1.0F);
                }
                around[static_cast<std::size_t>(n)] = (from != nullptr ? from : ones_.data()) + first_ray() - 1;
            }
            if (any) {
                mix(around, rows_.part, elements() + 3, line_.data());
                mix_along(line_.data(), columns_.part, elements(), 1.0F, mixed_.data());
            }
            put(rays_.start(plane_, row), any ? mixed_.data() : nullptr);
        }
    }

  private:
    /// Of a row of elements, with two zeros before and behind them.
    [[nodiscard]] std::size_t padded() const { return elements() + 4; }
    const float* read(int row, std::vector<float>& to) const {
        const float* from = grid_.values.data() + rays_.start(plane_, row);
        const std::size_t stride = rays_.columns().stride;
        if (stride == 1) {
            std::copy(from, from + elements(), to.begin() + 2);
        } else {
            for (std::size_t n = 0; n < elements(); ++n) {
                to[n + 2] = from[n * stride];
            }
        }
        return to.data();
    }

    const LightVolume& grid_;
    const Rays& rays_;
    const Filled& filled_;
    int first_, count_;
    std::size_t width_;
    std::vector<float> zeros_, ones_, mixed_, line_;
    std::array<std::vector<float>, 4> read_;
    int plane_ = 0;
    Between columns_, rows_;
};

LightVolume like(const LightVolume& grid) {
    return {grid.origin, grid.per_step, grid.counts, std::vector<float>(grid.values.size())};
}

void write(const float* from, std::size_t count, std::size_t stride, float* to) {
    for (std::size_t n = 0; n < count; ++n) {
        to[n * stride] = from != nullptr ? from[n] : 1.0F;
    }
}

/// Light along one band of rays.
void follow(Band band, const Rays& rays, LightVolume& left) {
    const std::size_t width = band.width(), rows = static_cast<std::size_t>(band.rows());
    // Absorbed before the plane; what is left at it; absorption at the plane before.
    std::vector<float> absorbed(rows * width, 0.0F), here(rows * width, 1.0F), before(rows * width, 0.0F);
    // Rows that nothing has dimmed yet; rows of which `here` is behind `absorbed`, and `before` is not 0.
    std::vector<unsigned char> clear(rows, 1), behind(rows, 0);
    // The sum over points a slice distance apart is the one over planes, with Euler and Maclaurin's terms at its
    // beginning: of the absorption there, and of its slope towards the light.
    const float each = rays.slices();
    const float slope = (each * each - 1.0F) / (12.0F * each), own = 0.5F * (each - 1.0F) - slope;
    const std::size_t stride = rays.columns().stride;
    for (int plane = 0; plane < rays.planes(); ++plane) {
        band.enter(plane);
        for (std::size_t row = 0; row < rows; ++row) {
            float* sum = absorbed.data() + row * width;
            float* out = here.data() + row * width;
            float* last = before.data() + row * width;
            const float* taken = band.absorption(static_cast<int>(row));
            if (taken != nullptr) {
                clear[row] = 0;
                behind[row] = 1;
                sum += band.first_ray();
                out += band.first_ray();
                last += band.first_ray();
                const std::size_t count = band.ray_count();
                for (std::size_t n = 0; n < count; ++n) {
                    out[n] = left_of(std::max(sum[n] + own * taken[n] + slope * last[n], 0.0F));
                    sum[n] += each * taken[n];
                    last[n] = taken[n];
                }
            } else if (behind[row] != 0) {
                behind[row] = 0;
                for (std::size_t n = 0; n < width; ++n) {
                    out[n] = left_of(std::max(sum[n] + slope * last[n], 0.0F));
                    last[n] = 0.0F;
                }
            }
        }
        band.put_rows(
            [&](int row) {
                const auto number = static_cast<std::size_t>(row);
                return clear[number] != 0 ? nullptr : here.data() + number * width;
            },
            [&](std::size_t start, const float* numbers) {
                write(numbers, band.elements(), stride, left.values.data() + start);
            });
    }
}

/// Moves elements so that numbers interpolated linearly between them, which lie above a curve that is hollow and below
/// one that is not, are nearest to those that the elements had: less a twelfth of the second differences.
void sharpen(LightVolume& volume, ThreadPool& pool, const std::function<void()>& poll) {
    constexpr float twelfth = 1.0F / 12.0F;
    constexpr int slab = 16;
    const auto [width, height, depth] = volume.counts;
    const std::size_t plane = volume.index(0, 0, 1), row = volume.index(0, 1, 0);
    const int slabs = (depth + slab - 1) / slab;
    // The planes before and behind each slab, as they were.
    std::vector<float> borders(2 * static_cast<std::size_t>(slabs) * plane);
    const auto keep = [&](int number, std::size_t place) {
        const float* from = volume.values.data() + static_cast<std::size_t>(std::clamp(number, 0, depth - 1)) * plane;
        std::copy(from, from + plane, borders.data() + place * plane);
    };
    for (int n = 0; n < slabs; ++n) {
        keep(n * slab - 1, 2 * static_cast<std::size_t>(n));
        keep((n + 1) * slab, 2 * static_cast<std::size_t>(n) + 1);
    }
    pool.run(
        static_cast<std::size_t>(slabs),
        [&](std::size_t task, int) {
            const int first = static_cast<int>(task) * slab, past = std::min(first + slab, depth);
            const float* last = borders.data() + 2 * task * plane;
            std::vector<float> before(last, last + plane), above(row), here(row);
            for (int z = first; z < past; ++z) {
                float* middle = volume.values.data() + static_cast<std::size_t>(z) * plane;
                const float* behind = z + 1 == past ? borders.data() + (2 * task + 1) * plane : middle + plane;
                std::copy(middle, middle + row, above.begin());
                for (int y = 0; y < height; ++y) {
                    float* out = middle + static_cast<std::size_t>(y) * row;
                    const float* below = y + 1 < height ? out + row : out;
                    float* front = before.data() + static_cast<std::size_t>(y) * row;
                    const float* back = behind + static_cast<std::size_t>(y) * row;
                    std::copy(out, out + row, here.begin());
                    const auto sharper = [&](std::size_t n, std::size_t left, std::size_t right) {
                        const float around = here[left] + here[right] + above[n] + below[n] + front[n] + back[n];
                        const float number = here[n] + twelfth * (6.0F * here[n] - around);
                        return std::min(std::max(number, 0.0F), 1.0F);
                    };
                    const auto end = static_cast<std::size_t>(width - 1);
                    out[0] = sharper(0, 0, std::min<std::size_t>(1, end));
                    for (std::size_t n = 1; n < end; ++n) {
                        out[n] = sharper(n, n - 1, n + 1);
                    }
                    if (end > 0) {
                        out[end] = sharper(end, end - 1, end);
                    }
                    std::copy(here.begin(), here.end(), front);
                    std::swap(here, above);
                }
            }
        },
        poll);
}

/// Adds share times what is left of light through the first `steps` slice distances along one band of rays.
void look_around(Band band, const Rays& rays, double steps, float share, LightVolume& open) {
    const std::size_t width = band.width(), rows = static_cast<std::size_t>(band.rows());
    const float each = rays.slices();
    const float near = std::min(0.5F / each, 1.0F);
    const Between far = between((steps + 0.5) / static_cast<double>(each));
    // Absorbed before each of the last planes, with half of the plane's own.
    const int ring = std::min(far.whole + 2, rays.planes() + 1);
    const std::size_t sheet = rows * width;
    std::vector<float> sums(static_cast<std::size_t>(ring) * sheet, 0.0F), before(sheet, 0.0F), here(sheet, 1.0F);
    const std::vector<float> nothing(width, 0.0F);
    std::vector<float> taken(width, 0.0F);
    std::vector<int> quiet(rows, ring + 1); ///< planes since a row met anything
    const std::size_t stride = rays.columns().stride;
    for (int plane = 0; plane < rays.planes(); ++plane) {
        band.enter(plane);
        // Planes before the first one hold nothing.
        const auto at = [&](int number, std::size_t row) -> float* {
            return sums.data() + static_cast<std::size_t>((number + ring) % ring) * sheet + row * width;
        };
        for (std::size_t row = 0; row < rows; ++row) {
            const float* own = band.absorption(static_cast<int>(row));
            quiet[row] = own != nullptr ? 0 : quiet[row] + 1;
            float* sum = at(plane, row);
            const float* last = plane > 0 ? at(plane - 1, row) : nothing.data();
            if (quiet[row] > ring) {
                if (quiet[row] <= 2 * ring + 1) {
                    std::copy(last, last + width, sum);
                }
                continue;
            }
            std::fill(taken.begin(), taken.end(), 0.0F);
            if (own != nullptr) {
                std::copy(own, own + band.ray_count(), taken.begin() + static_cast<std::ptrdiff_t>(band.first_ray()));
            }
            const bool whole = plane < far.whole, half = plane < far.whole + 1;
            const float* far_near = whole ? nothing.data() : at(plane - far.whole, row);
            const float* far_off = half ? nothing.data() : at(plane - far.whole - 1, row);
            float* previous = before.data() + row * width;
            float* out = here.data() + row * width;
            const float part = far.part;
            const bool itself = far.whole == 0;
            for (std::size_t n = 0; n < width; ++n) {
                const float total = last[n] + 0.5F * each * (previous[n] + taken[n]);
                // The integral of what is linear from plane to plane over the first half of a slice distance.
                const float first = each * near * (taken[n] - 0.5F * near * (taken[n] - previous[n]));
                const float from = itself ? total : far_near[n];
                const float beyond = from + part * (far_off[n] - from);
                out[n] = left_of(std::max(total - first - beyond, 0.0F));
                sum[n] = total;
                previous[n] = taken[n];
            }
        }
        band.put_rows(
            [&](int row) {
                const auto number = static_cast<std::size_t>(row);
                return quiet[number] > ring ? nullptr : here.data() + number * width;
            },
            [&](std::size_t start, const float* numbers) {
                float* to = open.values.data() + start;
                for (std::size_t n = 0; n < band.elements(); ++n) {
                    to[n * stride] += share * (numbers != nullptr ? numbers[n] : 1.0F);
                }
            });
    }
}

} // namespace

LightVolume halved(const LightVolume& volume) {
    LightVolume half{volume.origin, volume.per_step, volume.counts, volume.values};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const LightVolume from = std::move(half);
        half = {from.origin, from.per_step, from.counts, {}};
        half.counts[axis] = from.counts[axis] / 2 + 1;
        half.per_step[axis] *= 0.5;
        half.values.resize(half.index(0, 0, half.counts[2]));
        const std::size_t inner = axis == 0 ? 1 : axis == 1 ? from.index(0, 1, 0) : from.index(0, 0, 1);
        const auto many = static_cast<std::size_t>(from.counts[axis]);
        const auto fewer = static_cast<std::size_t>(half.counts[axis]);
        const std::size_t outer = from.values.size() / (inner * many);
        for (std::size_t block = 0; block < outer; ++block) {
            for (std::size_t n = 0; n < fewer; ++n) {
                float* to = half.values.data() + (block * fewer + n) * inner;
                for (std::size_t neighbour = 0; neighbour < 3; ++neighbour) {
                    const std::size_t place = 2 * n + neighbour;
                    if (place < 1 || place > many) {
                        continue;
                    }
                    const float* values = from.values.data() + (block * many + place - 1) * inner;
                    const float weight = neighbour == 1 ? 0.5F : 0.25F;
                    for (std::size_t element = 0; element < inner; ++element) {
                        to[element] += weight * values[element];
                    }
                }
            }
        }
    }
    return half;
}

LightVolume transmittance(const LightVolume& absorption, const Vec3& towards_light, double slice_spacing,
                          ThreadPool& pool, const std::function<void()>& poll) {
    const Rays rays(absorption, towards_light, slice_spacing);
    const Filled filled(absorption, rays);
    LightVolume left = like(absorption);
    pool.run(
        rays.bands(), [&](std::size_t number, int) { follow(Band(absorption, rays, filled, number), rays, left); },
        poll);
    sharpen(left, pool, poll);
    return left;
}

LightVolume openness(const LightVolume& absorption, const std::vector<Vec3>& directions, double steps,
                     double slice_spacing, ThreadPool& pool, const std::function<void()>& poll) {
    LightVolume open = like(absorption);
    const float share = 1.0F / static_cast<float>(directions.size());
    for (const Vec3& direction : directions) {
        const Rays rays(absorption, direction, slice_spacing);
        const Filled filled(absorption, rays);
        pool.run(
            rays.bands(),
            [&](std::size_t number, int) {
                look_around(Band(absorption, rays, filled, number), rays, steps, share, open);
            },
            poll);
    }
    return open;
}

} // namespace sheetsplat
