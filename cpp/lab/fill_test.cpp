#include "lab/fill_test.hpp"

#include <algorithm>
#include <chrono>
#include <ctime>
#include <random>
#include <string>
#include <vector>

#include "gl/context.hpp"
#include "gl/objects.hpp"
#include "gl/program.hpp"
#include "lab_glsl.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat::lab {

Seconds fill_test(std::size_t kernels, double diameter_px, int width, int height, int targets, int repeats) {
    if (!(diameter_px >= 1.0) || width < 1 || height < 1 || targets < 1 || targets > 4 || repeats < 1) {
        throw InvalidInput(
            Complaint{"the fill test cannot be run", "a diameter, size or number of targets out of range",
                      "a diameter of at least 1 pixel, at least 1 x 1 pixels, 1 to 4 targets, at least 1 repeat",
                      "correct the arguments"});
    }
    const auto context = gl::Context::create({});
    const gl::Current current(*context);
    const gl::Api& gl = context->api();
    std::vector<gl::Texture> textures;
    std::vector<gl::Attachment> colors;
    std::vector<std::string> outputs;
    for (int target = 0; target < targets; ++target) {
        textures.emplace_back(gl, GL_RGBA32F, width, height);
        outputs.push_back("fill_" + std::to_string(target));
    }
    for (const gl::Texture& texture : textures) {
        colors.emplace_back(&texture);
    }
    const gl::Framebuffer framebuffer(gl, colors);
    const gl::Program program(gl, embedded_glsl(), "fill.vert", "fill.frag", {{"TARGETS", std::to_string(targets)}},
                              "#version 330 core", outputs);
    std::vector<float> positions;
    std::mt19937 random(1);
    std::uniform_real_distribution<float> spread(-1.0F, 1.0F);
    for (std::size_t number = 0; number < 2 * kernels; ++number) {
        positions.push_back(spread(random));
    }
    gl::Buffer buffer(gl, GL_ARRAY_BUFFER);
    const gl::VertexArray array(gl);
    framebuffer.bind();
    gl.Viewport(0, 0, width, height);
    gl.Clear(GL_COLOR_BUFFER_BIT);
    gl.Enable(GL_BLEND);
    gl.BlendFunc(GL_ONE, GL_ONE);
    gl.Disable(GL_DEPTH_TEST);
    gl.Enable(GL_PROGRAM_POINT_SIZE);
    program.use();
    program.set("point_size", static_cast<float>(diameter_px));
    array.bind();
    buffer.upload(positions.data(), positions.size() * sizeof(float));
    gl.EnableVertexAttribArray(0);
    gl.VertexAttribPointer(0, 2, GL_FLOAT, GL_FALSE, 0, nullptr);
    // The first draw compiles the program.
    gl.DrawArrays(GL_POINTS, 0, 1);
    gl.Finish();
    std::vector<Seconds> times;
    for (int repeat = 0; repeat < repeats; ++repeat) {
        const auto started = std::chrono::steady_clock::now();
        const std::clock_t worked = std::clock();
        gl.DrawArrays(GL_POINTS, 0, static_cast<GLsizei>(kernels));
        gl.Finish();
        times.push_back({std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count(),
                         static_cast<double>(std::clock() - worked) / CLOCKS_PER_SEC});
    }
    gl::check_errors(gl, "the fill test");
    std::sort(times.begin(), times.end(), [](const Seconds& a, const Seconds& b) { return a.cpu < b.cpu; });
    return times[times.size() / 2];
}

} // namespace sheetsplat::lab
