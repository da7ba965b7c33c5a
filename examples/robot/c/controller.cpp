// The robot's controller in C++: finds the ball in each image, in place in shared memory, and turns towards it.
#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <optional>

#include <busd/busd.hpp>

#include "geometry_msgs/msg/Twist.hpp"
#include "sensor_msgs/msg/Image.hpp"

using geometry_msgs::msg::Twist;
using sensor_msgs::msg::Image;

static volatile std::sig_atomic_t has_ended = 0;

// The direction of the ball in radians to the left; none if the image has no ball.
static std::optional<double> find_ball(const Image &image)
{
    constexpr double focal_px = 554;
    std::size_t area = 0, columns = 0;
    if (image.encoding != "rgb8" || image.step < std::size_t(3) * image.width
        || image.data.size() < std::size_t(image.step) * image.height)
        return std::nullopt;
    for (std::size_t y = 0; y < image.height; y++)
        for (std::size_t x = 0; x < image.width; x++)
            if (image.data[y * image.step + 3 * x] >= 200) {
                area++;
                columns += x;
            }
    if (area < 20)
        return std::nullopt;
    return std::atan2(image.width / 2.0 - double(columns) / double(area), focal_px);
}

int main()
{
    for (const int number : {SIGINT, SIGTERM})
        std::signal(number, [](int) { has_ended = 1; });
    try {
        unsigned images = 0, in_place = 0;
        double last = 0;
        busd::bus bus("controller");
        busd::node node = bus.create_node("controller");
        auto commands = node.create_publisher<Twist>("/cmd_vel", busd::qos().depth(1));
        auto camera = node.create_subscription<Image>(
            "/camera/image_raw", busd::qos().depth(5).best_effort(), [&](const Image &image, const busd_message &info) {
                const std::optional<double> bearing = find_ball(image);
                Twist command;
                command.angular.z = bearing ? std::clamp(2 * *bearing, -2.0, 2.0) : 0.8; // else it looks around
                commands.publish(command);
                images++;
                in_place += info.by_ring != 0;
                last = bearing.value_or(M_PI);
            });
        while (!has_ended)
            bus.wait();
        std::printf("controller (C++): %u images, %u in shared memory; the ball is %.0f degrees from the middle\n", images,
                    in_place, std::abs(last) * 180 / M_PI);
    } catch (const busd::error &error) {
        std::fprintf(stderr, "controller: %s\n", error.what());
        return 1;
    }
}
