#pragma once

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

// A PNG with one small line chart for each quantity, side by side.
struct LineChart {
  struct Series {
    std::string name;
    std::vector<double> y;
  };
  std::string x_title, y_title;
  std::vector<double> x;
  std::vector<Series> series;
};

// The step of about four ticks over a range: 1, 2, 2.5 or 5 times a power of ten.
inline double tick_step(double range) {
  const double rough = range / 4, power = std::pow(10.0, std::floor(std::log10(rough)));
  for (const double factor : {1.0, 2.0, 2.5, 5.0}) {
    if (factor * power >= 0.999 * rough) return factor * power;
  }
  return 10 * power;
}

inline void draw_charts(const std::vector<LineChart>& charts, const std::filesystem::path& path) {
  constexpr int kWidth = 420, kHeight = 300, kLeft = 70, kRight = 15, kTop = 56, kBottom = 45;
  const std::vector<cv::Scalar> colours = {
      {40, 140, 40}, {40, 40, 220}, {220, 120, 30}, {160, 30, 160}, {90, 90, 90}};
  cv::Mat image(kHeight, kWidth * static_cast<int>(charts.size()), CV_8UC3, cv::Scalar::all(255));
  const auto text = [&](const std::string& line, cv::Point at, const cv::Scalar& colour, double size = 0.4) {
    cv::putText(image, line, at, cv::FONT_HERSHEY_SIMPLEX, size, colour, 1, cv::LINE_AA);
  };
  for (size_t c = 0; c < charts.size(); ++c) {
    const LineChart& chart = charts[c];
    double low = 0, high = 1e-12;
    for (const auto& s : chart.series) {
      for (const double y : s.y) {
        if (std::isfinite(y)) low = std::min(low, y), high = std::max(high, y);
      }
    }
    const double x0 = chart.x.front(), x1 = chart.x.back();
    const double y_step = tick_step(high - low), x_step = tick_step(x1 - x0);
    low = y_step * std::floor(low / y_step + 1e-9);
    high = y_step * std::ceil(high / y_step - 1e-9);
    const int offset = kWidth * static_cast<int>(c);
    const auto at = [&](double x, double y) {
      return cv::Point(
          offset + kLeft + int(std::lround((x - x0) / (x1 - x0) * (kWidth - kLeft - kRight))),
          kHeight - kBottom - int(std::lround((y - low) / (high - low) * (kHeight - kTop - kBottom))));
    };
    const cv::Scalar black = cv::Scalar::all(0), grey = cv::Scalar::all(220);
    char label[32];
    for (double y = low; y <= high + 1e-9 * y_step; y += y_step) {
      cv::line(image, at(x0, y), at(x1, y), grey);
      std::snprintf(label, sizeof(label), "%.4g", std::abs(y) < 1e-9 * y_step ? 0.0 : y);
      text(label, at(x0, y) + cv::Point(-55, 4), black, 0.35);
    }
    for (double x = x_step * std::ceil(x0 / x_step - 1e-9); x <= x1 + 1e-9 * x_step; x += x_step) {
      cv::line(image, at(x, low), at(x, high), grey);
      std::snprintf(label, sizeof(label), "%.4g", std::abs(x) < 1e-9 * x_step ? 0.0 : x);
      text(label, at(x, low) + cv::Point(-8, 15), black, 0.35);
    }
    cv::line(image, at(x0, low), at(x1, low), black);
    cv::line(image, at(x0, low), at(x0, high), black);
    text(chart.y_title, {offset + kLeft, 15}, black);
    text(chart.x_title, {offset + kWidth / 2, kHeight - 10}, black);
    for (size_t s = 0; s < chart.series.size(); ++s) {
      const auto& series = chart.series[s];
      for (size_t i = 1; i < chart.x.size(); ++i) {
        if (!std::isfinite(series.y[i - 1]) || !std::isfinite(series.y[i])) continue;
        cv::line(image, at(chart.x[i - 1], series.y[i - 1]), at(chart.x[i], series.y[i]),
                 colours[s % colours.size()], 2, cv::LINE_AA);
      }
      text(series.name,
           {offset + kLeft + 5 + 160 * static_cast<int>(s % 2), 32 + 14 * static_cast<int>(s / 2)},
           colours[s % colours.size()]);
    }
  }
  cv::imwrite(path.string(), image);
}
