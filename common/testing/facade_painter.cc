#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "testing/texture_painter.h"

namespace portolan {
namespace {

int Between(int low, int high, Random* random) {
  return low + static_cast<int>(random->Below(static_cast<uint64_t>(std::max(1, high - low + 1))));
}

cv::Mat PaintMaterial(int side, Random* random) {
  switch (random->Below(4)) {
    case 0:
      return PaintBricks(side, Between(36, 60, random), random->Uniform(90, 160), random);
    case 1:
      return PaintBricks(side, Between(10, 18, random), random->Uniform(140, 200), random);  // ashlar
    case 2:
      return PaintPavement(side, Between(6, 10, random), random);  // panels
    default:
      return PaintNoise({side, side}, random->Uniform(120, 200), 70, side / 8, random);  // plaster
  }
}

/// How the windows of one house look; each window differs in curtains and reflections.
struct WindowStyle {
  double frame, width, height;
  int bars_across, bars_down, thickness;
  bool shutters, lintel, sill;
};

WindowStyle MakeWindowStyle(int side, Random* random) {
  WindowStyle style;
  style.frame = random->Below(2) ? random->Uniform(200, 245) : random->Uniform(30, 80);
  style.width = random->Uniform(0.38, 0.62);
  style.height = random->Uniform(0.45, 0.68);
  style.bars_across = Between(0, 3, random);
  style.bars_down = Between(0, 2, random);
  style.thickness = std::max(2, side / 160);
  style.shutters = random->Below(3) == 0;
  style.lintel = random->Below(2) == 0;
  style.sill = random->Below(2) == 0;
  return style;
}

void PaintWindow(cv::Mat* picture, const cv::Rect& opening, const WindowStyle& style, Random* random) {
  cv::Mat glass = (*picture)(opening);
  PaintNoise(opening.size(), random->Uniform(35, 95), 40, std::max(4, opening.width / 3), random).copyTo(glass);
  if (random->Below(3) > 0) {  // curtains, or a reflection
    const int fold = Between(opening.width / 8, opening.width / 2, random);
    cv::rectangle(glass, {0, 0}, {fold, opening.height}, random->Uniform(120, 220), cv::FILLED);
    if (random->Below(2)) {
      cv::rectangle(glass, {opening.width - fold, 0}, {opening.width, opening.height}, random->Uniform(120, 220),
                    cv::FILLED);
    }
  }
  if (random->Below(4) == 0) {  // flowers, a cat, a lamp
    cv::circle(glass, {Between(0, opening.width, random), opening.height * 4 / 5}, opening.width / 6,
               random->Uniform(10, 240), cv::FILLED, cv::LINE_AA);
  }
  const int t = style.thickness;
  for (int i = 1; i <= style.bars_down; ++i) {
    const int x = opening.width * i / (style.bars_down + 1);
    cv::rectangle(glass, {x - t / 2, 0}, {x + t / 2, opening.height}, style.frame, cv::FILLED);
  }
  for (int i = 1; i <= style.bars_across; ++i) {
    const int y = opening.height * i / (style.bars_across + 1);
    cv::rectangle(glass, {0, y - t / 2}, {opening.width, y + t / 2}, style.frame, cv::FILLED);
  }
  cv::rectangle(*picture, opening, style.frame, t);
  const auto bar = [&](int dx, int y, int width, int height, double tone) {
    cv::rectangle(*picture, cv::Rect(opening.x + dx, y, width, height), tone, cv::FILLED);
  };
  if (style.lintel) bar(-2 * t, opening.y - 3 * t, opening.width + 4 * t, 2 * t, 215);
  if (style.sill) bar(-2 * t, opening.y + opening.height + t, opening.width + 4 * t, 2 * t, 60);
  if (style.shutters) {
    const int width = opening.width / 3;
    bar(-width - t, opening.y, width, opening.height, 70);
    bar(opening.width + t, opening.y, width, opening.height, 70);
    for (int y = opening.y; y < opening.y + opening.height; y += 3 * t) {
      bar(-width - t, y, width, t, 110);
      bar(opening.width + t, y, width, t, 110);
    }
  }
}

void PaintDoor(cv::Mat* picture, const cv::Rect& door, Random* random) {
  const double tone = random->Uniform(40, 170);
  cv::rectangle(*picture, door, tone, cv::FILLED);
  const int rows = Between(2, 4, random);
  for (int row = 0; row < rows; ++row) {
    const cv::Rect panel(door.x + door.width / 6, door.y + door.height * row / rows + door.height / 20,
                         door.width * 4 / 6, door.height / rows - door.height / 10);
    cv::rectangle(*picture, panel, row == 0 ? random->Uniform(20, 240) : tone * 0.7, cv::FILLED);
  }
  cv::rectangle(*picture, door, tone > 110 ? 30 : 220, std::max(2, door.width / 16));
  cv::circle(*picture, {door.x + door.width * 7 / 8, door.y + door.height / 2}, std::max(2, door.width / 18), 240,
             cv::FILLED);
}

/// Shop windows or doors and posters at street level.
void PaintGroundFloor(cv::Mat* picture, const cv::Rect& floor, const WindowStyle& style, Random* random) {
  const int fields = Between(3, 5, random), width = floor.width / fields;
  const bool shop = random->Below(2) == 0;
  const int sign = shop ? floor.height / 5 : 0;
  if (shop) {
    const double board = random->Uniform(20, 235);
    cv::rectangle(*picture, cv::Rect(floor.x, floor.y, floor.width, sign), board, cv::FILLED);
    PaintLettering(picture, cv::Rect(floor.x + width / 4, floor.y + sign / 8, floor.width - width / 2, sign * 6 / 8),
                   board > 128 ? 20 : 240, random);
  }
  const int door = Between(0, fields - 1, random);
  for (int i = 0; i < fields; ++i) {
    const cv::Rect field(floor.x + i * width + width / 8, floor.y + sign + floor.height / 8, width * 3 / 4,
                         floor.height * 7 / 8 - sign);
    if (i == door) {
      PaintDoor(picture, field, random);
    } else if (shop || random->Below(3) == 0) {
      PaintWindow(picture, {field.x, field.y, field.width, field.height * 3 / 4}, style, random);
    } else {
      const cv::Size size(field.width * Between(5, 9, random) / 10, field.height * Between(4, 7, random) / 10);
      PaintPoster(size, random).copyTo((*picture)(cv::Rect(field.tl(), size)));
    }
  }
}

void PaintDirt(cv::Mat* picture, Random* random) {
  const int side = picture->cols;
  for (int k = Between(0, 2, random); k > 0; --k) {  // pipes
    const int x = Between(side / 20, side * 19 / 20, random);
    cv::line(*picture, {x, 0}, {x, side}, random->Uniform(40, 90), std::max(2, side / 100));
    for (int y = Between(0, side / 6, random); y < side; y += side / 6) {
      cv::rectangle(*picture, cv::Rect(x - side / 80, y, side / 40, side / 100 + 1), 210, cv::FILLED);
    }
  }
  for (int k = 0; k < 14; ++k) {  // patches of other plaster
    const cv::Point centre(Between(0, side, random), Between(0, side, random));
    cv::ellipse(*picture, centre, {Between(side / 100, side / 30, random), Between(side / 100, side / 24, random)},
                random->Uniform(0, 180), 0, 360, random->Uniform(60, 220), cv::FILLED, cv::LINE_AA);
  }
}

}  // namespace

cv::Mat PaintFacade(int side, int storeys, Random* random) {
  cv::Mat picture = PaintMaterial(side, random);
  PaintDirt(&picture, random);
  const WindowStyle style = MakeWindowStyle(side, random);
  const int columns = Between(3, 5, random), width = side / columns, height = side / storeys;
  const double band = random->Uniform(50, 230);
  for (int storey = 0; storey + 1 < storeys; ++storey) {
    for (int column = 0; column < columns; ++column) {
      const int w = static_cast<int>(width * style.width), h = static_cast<int>(height * style.height);
      const cv::Rect opening(column * width + (width - w) / 2, storey * height + (height - h) / 2, w, h);
      if (random->Below(12) == 0) {  // a walled-up window: a sign in its place
        PaintPoster(opening.size(), random).copyTo(picture(opening));
      } else {
        PaintWindow(&picture, opening, style, random);
      }
    }
    if (random->Below(2)) {
      cv::rectangle(picture, cv::Rect(0, (storey + 1) * height - side / 100, side, side / 80 + 1), band, cv::FILLED);
    }
  }
  PaintGroundFloor(&picture, {0, (storeys - 1) * height, side, height}, style, random);
  cv::rectangle(picture, cv::Rect(0, 0, side, side / 40), random->Uniform(50, 90), cv::FILLED);  // the eaves
  for (int x = 0; x < side; x += side / 24)
    cv::rectangle(picture, cv::Rect(x, 0, side / 60, side / 50), 200, cv::FILLED);
  const cv::Mat grain = PaintNoise(picture.size(), 128, 26, 32, random);
  cv::multiply(picture, grain, picture, 1.0 / 128);
  return picture;
}

}  // namespace portolan
