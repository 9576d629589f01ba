#include "dataset/plot_canvas.h"

#include <fmt/format.h>

#include <cmath>
#include <iterator>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "base/atomic_file.h"
#include "base/check.h"

namespace portolan {
namespace {

constexpr double kPngScale = 2;      // sharp on dense screens
constexpr int kSubpixelBits = 4;     // of OpenCV's drawing coordinates
constexpr double kCapHeight = 0.72;  // of a letter's size, in common fonts

std::string Hex(PlotColor color) {
  return fmt::format("#{:02x}{:02x}{:02x}", color.red, color.green, color.blue);
}
cv::Scalar Bgr(PlotColor color) {
  return cv::Scalar(color.blue, color.green, color.red);
}

cv::Point Subpixel(PlotPoint point) {
  const double scale = kPngScale * (1 << kSubpixelBits);
  return {static_cast<int>(std::lround(point.x * scale)), static_cast<int>(std::lround(point.y * scale))};
}

std::string EscapeXml(const std::string& text) {
  std::string escaped;
  for (const char letter : text) {
    switch (letter) {
      case '&':
        escaped += "&amp;";
        break;
      case '<':
        escaped += "&lt;";
        break;
      case '>':
        escaped += "&gt;";
        break;
      default:
        escaped += letter;
    }
  }
  return escaped;
}

const char* AnchorName(TextAnchor anchor) {
  return anchor == TextAnchor::kStart ? "start" : anchor == TextAnchor::kMiddle ? "middle" : "end";
}

bool EndsWith(const std::string& text, const std::string& end) {
  return text.size() >= end.size() && text.compare(text.size() - end.size(), end.size(), end) == 0;
}

}  // namespace

void PlotCanvas::AddLine(std::vector<PlotPoint> points, PlotColor color, double line_width) {
  lines_.push_back({std::move(points), color, line_width});
}

void PlotCanvas::AddDot(PlotPoint center, double radius, PlotColor color) {
  dots_.push_back({center, radius, color});
}

void PlotCanvas::AddText(PlotPoint baseline, const std::string& text, double size, PlotColor color, TextAnchor anchor) {
  texts_.push_back({baseline, text, size, color, anchor});
}

std::string PlotCanvas::ToSvg() const {
  std::string svg = fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0:.0f}\" height=\"{1:.0f}\" viewBox=\"0 0 {0:.0f} {1:.0f}\" "
      "font-family=\"Helvetica, Arial, sans-serif\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n",
      width_, height_);
  auto out = std::back_inserter(svg);
  for (const Line& line : lines_) {
    fmt::format_to(out, "<polyline fill=\"none\" stroke=\"{}\" stroke-width=\"{}\" stroke-linejoin=\"round\" points=\"",
                   Hex(line.color), line.width);
    for (const PlotPoint& point : line.points) fmt::format_to(out, "{:.2f},{:.2f} ", point.x, point.y);
    svg += "\"/>\n";
  }
  for (const Dot& dot : dots_) {
    fmt::format_to(out, "<circle cx=\"{:.2f}\" cy=\"{:.2f}\" r=\"{}\" fill=\"{}\"/>\n", dot.center.x, dot.center.y,
                   dot.radius, Hex(dot.color));
  }
  for (const Text& text : texts_) {
    fmt::format_to(out, "<text x=\"{:.2f}\" y=\"{:.2f}\" font-size=\"{}\" fill=\"{}\" text-anchor=\"{}\">{}</text>\n",
                   text.baseline.x, text.baseline.y, text.size, Hex(text.color), AnchorName(text.anchor),
                   EscapeXml(text.text));
  }
  return svg + "</svg>\n";
}

std::string PlotCanvas::ToPng() const {
  cv::Mat picture(static_cast<int>(height_ * kPngScale), static_cast<int>(width_ * kPngScale), CV_8UC3,
                  cv::Scalar::all(255));
  for (const Line& line : lines_) {
    std::vector<cv::Point> points;
    for (const PlotPoint& point : line.points) points.push_back(Subpixel(point));
    const int thickness = std::max(1, static_cast<int>(std::lround(line.width * kPngScale)));
    cv::polylines(picture, points, false, Bgr(line.color), thickness, cv::LINE_AA, kSubpixelBits);
  }
  for (const Dot& dot : dots_) {
    const int radius = static_cast<int>(std::lround(dot.radius * kPngScale * (1 << kSubpixelBits)));
    cv::circle(picture, Subpixel(dot.center), radius, Bgr(dot.color), cv::FILLED, cv::LINE_AA, kSubpixelBits);
  }
  for (const Text& text : texts_) {
    const int thickness = 2;
    const double scale = cv::getFontScaleFromHeight(cv::FONT_HERSHEY_SIMPLEX,
                                                    static_cast<int>(text.size * kCapHeight * kPngScale), thickness);
    const int width = cv::getTextSize(text.text, cv::FONT_HERSHEY_SIMPLEX, scale, thickness, nullptr).width;
    const double shift = text.anchor == TextAnchor::kStart ? 0 : text.anchor == TextAnchor::kMiddle ? 0.5 : 1;
    const cv::Point origin(static_cast<int>(text.baseline.x * kPngScale - shift * width),
                           static_cast<int>(text.baseline.y * kPngScale));
    cv::putText(picture, text.text, origin, cv::FONT_HERSHEY_SIMPLEX, scale, Bgr(text.color), thickness, cv::LINE_AA);
  }
  std::vector<uchar> bytes;
  PORTOLAN_CHECK(cv::imencode(".png", picture, bytes));
  return std::string(bytes.begin(), bytes.end());
}

Status PlotCanvas::Write(const std::string& path) const {
  if (EndsWith(path, ".svg")) return WriteFileAtomically(path, ToSvg());
  if (EndsWith(path, ".png")) return WriteFileAtomically(path, ToPng());
  return Error{path + ": a plot's name must end in .svg or .png"};
}

}  // namespace portolan
