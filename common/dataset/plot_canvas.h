#pragma once

#include <string>
#include <vector>

#include "base/result.h"

namespace portolan {

/// 8-bit red, green, blue.
struct PlotColor {
  int red = 0, green = 0, blue = 0;
};

/// On the canvas: pixels from its top-left corner.
struct PlotPoint {
  double x = 0, y = 0;
};

enum class TextAnchor { kStart, kMiddle, kEnd };

/// A drawing of lines, dots and text on white, written as SVG or PNG.
class PlotCanvas {
 public:
  PlotCanvas(double width, double height) : width_(width), height_(height) {}

  void AddLine(std::vector<PlotPoint> points, PlotColor color, double line_width);
  void AddDot(PlotPoint center, double radius, PlotColor color);
  /// @param baseline where the text starts, has its middle or ends. @param size of the letters, pixels.
  void AddText(PlotPoint baseline, const std::string& text, double size, PlotColor color,
               TextAnchor anchor = TextAnchor::kStart);

  std::string ToSvg() const;
  /// The bytes of a PNG of twice the canvas's size.
  std::string ToPng() const;
  /// By the name's end, .svg or .png; fails on another, or if the file can't be written.
  Status Write(const std::string& path) const;

 private:
  struct Line {
    std::vector<PlotPoint> points;
    PlotColor color;
    double width;
  };
  struct Dot {
    PlotPoint center;
    double radius;
    PlotColor color;
  };
  struct Text {
    PlotPoint baseline;
    std::string text;
    double size;
    PlotColor color;
    TextAnchor anchor;
  };

  double width_, height_;
  std::vector<Line> lines_;
  std::vector<Dot> dots_;  ///< over the lines
  std::vector<Text> texts_;
};

}  // namespace portolan
