// Driving function in a process of its own: brakes with 2 m/s2, straight on.
// Build: g++ -O2 -o process_driver process_driver.cpp
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <string>

// The first number after "key": in a line; the vehicle that is asked for comes first in it.
static double number(const std::string& line, const char* key, size_t from) {
    const std::string quoted = std::string("\"") + key + "\":";
    const size_t at = line.find(quoted, from);
    return at == std::string::npos ? 0.0 : std::strtod(line.c_str() + at + quoted.size(), nullptr);
}

static std::string list(const char* key, const double* values, int count) {
    std::string text = std::string("\"") + key + "\": [";
    char digits[32];
    for (int i = 0; i < count; ++i) {
        std::snprintf(digits, sizeof digits, "%s%.9g", i ? ", " : "", values[i]);
        text += digits;
    }
    return text + "]";
}

int main() {
    const int steps = 30;
    const double step_s = 0.1, braking = 2.0;
    std::ios::sync_with_stdio(false);
    std::string line;
    std::getline(std::cin, line);  // the road
    std::cout << "{\"ready\": true}" << std::endl;
    while (std::getline(std::cin, line)) {
        const size_t me = line.find("\"vehicle\":");
        double x = number(line, "x", me), y = number(line, "y", me);
        const double heading = number(line, "heading", me);
        double speed = number(line, "speed", me);
        double xs[steps], ys[steps], headings[steps], speeds[steps];
        for (int i = 0; i < steps; ++i) {
            speed = std::fmax(0.0, speed - braking * step_s);
            xs[i] = x += speed * step_s * std::cos(heading);
            ys[i] = y += speed * step_s * std::sin(heading);
            headings[i] = heading;
            speeds[i] = speed;
        }
        std::cout << "{" << list("x", xs, steps) << ", " << list("y", ys, steps) << ", "
                  << list("heading", headings, steps) << ", " << list("speed", speeds, steps) << "}" << std::endl;
    }
}
