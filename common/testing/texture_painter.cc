#include "testing/texture_painter.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace portolan {
namespace {

int Between(int low, int high, Random* random) {
  return low + static_cast<int>(random->Below(static_cast<uint64_t>(std::max(1, high - low + 1))));
}

/// Multiplies the picture by noise around 1: dirt and grain, so that no field is flat.
void AddGrain(cv::Mat* picture, double amplitude, Random* random) {
  const cv::Mat noise = PaintNoise(picture->size(), 128, amplitude * 128, 64, random);
  cv::multiply(*picture, noise, *picture, 1.0 / 128);
}

void AddCracks(cv::Mat* picture, int count, double ink, Random* random) {
  const double step = picture->cols / 40.0;
  for (int i = 0; i < count; ++i) {
    cv::Point2d at(random->Uniform(0, picture->cols), random->Uniform(0, picture->rows));
    double heading = random->Uniform(0, 2 * M_PI);
    for (int k = Between(4, 12, random); k > 0; --k) {
      heading += random->Uniform(-0.8, 0.8);
      const cv::Point2d next = at + step * cv::Point2d(std::cos(heading), std::sin(heading));
      cv::line(*picture, at, next, ink, std::max(1, picture->cols / 800), cv::LINE_AA);
      at = next;
    }
  }
}

/// A sheet somewhere within each of columns x rows fields, with a probability; `low` and `high` bound its sides as
/// shares of the field's.
void PinUp(cv::Mat* wall, int columns, int rows, double probability, double low, double high, Random* random) {
  const int width = wall->cols / columns, height = wall->rows / rows;
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      if (random->Uniform() > probability) continue;
      const cv::Size sheet(static_cast<int>(width * random->Uniform(low, high)),
                           static_cast<int>(height * random->Uniform(low, high)));
      const cv::Point corner(column * width + Between(0, width - sheet.width - 1, random),
                             row * height + Between(0, height - sheet.height - 1, random));
      PaintPoster(sheet, random).copyTo((*wall)(cv::Rect(corner, sheet)));
    }
  }
}

}  // namespace

cv::Mat PaintNoise(cv::Size size, double mean, double amplitude, int coarsest_px, Random* random) {
  cv::Mat sum(size, CV_32FC1, cv::Scalar(mean));
  double share = amplitude / 2;
  for (int cell = coarsest_px; cell >= 2; cell /= 2, share *= 0.7) {
    cv::Mat coarse(size.height / cell + 2, size.width / cell + 2, CV_32FC1), fine;
    for (int y = 0; y < coarse.rows; ++y) {
      for (int x = 0; x < coarse.cols; ++x) coarse.at<float>(y, x) = static_cast<float>(random->Uniform(-share, share));
    }
    cv::resize(coarse, fine, size, 0, 0, cv::INTER_CUBIC);
    sum += fine;
  }
  cv::Mat picture;
  sum.convertTo(picture, CV_8UC1);
  return picture;
}

cv::Mat PaintBricks(int side, int rows, double tone, Random* random) {
  cv::Mat picture(side, side, CV_8UC1, cv::Scalar(tone * 0.65));
  const double height = static_cast<double>(side) / rows, width = 2.2 * height;
  const int joint = std::max(1, static_cast<int>(height / 8));
  for (int row = 0; row < rows; ++row) {
    for (double x = (row % 2) * -width / 2; x < side; x += width) {
      const cv::Point low(static_cast<int>(x) + joint, static_cast<int>(row * height) + joint);
      const cv::Point high(static_cast<int>(x + width) - 1, static_cast<int>((row + 1) * height) - 1);
      cv::rectangle(picture, low, high, tone + random->Uniform(-28, 28), cv::FILLED);
    }
  }
  AddGrain(&picture, 0.25, random);
  return picture;
}

cv::Mat PaintCobbles(int side, int rows, Random* random) {
  cv::Mat picture = PaintNoise({side, side}, 62, 20, 16, random);
  const double cell = static_cast<double>(side) / rows;
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < rows; ++column) {
      const double shift = (row % 2) * 0.5;
      const cv::Point2d centre((column + shift + random->Uniform(0.38, 0.62)) * cell,
                               (row + random->Uniform(0.38, 0.62)) * cell);
      const cv::Size2d half(cell * random->Uniform(0.3, 0.48), cell * random->Uniform(0.28, 0.46));
      const double tone = random->Uniform(100, 165), angle = random->Uniform(-25, 25);
      for (const double wrap_x :
           {0.0, -static_cast<double>(side)}) {  // a stone over the right side goes on at the left
        const cv::RotatedRect stone(centre + cv::Point2d(wrap_x, 0), half * 2.0, static_cast<float>(angle));
        if (random->Below(3) == 0) {
          cv::Point2f corners[4];
          stone.points(corners);
          const std::vector<cv::Point> polygon(corners, corners + 4);
          cv::fillConvexPoly(picture, polygon, tone, cv::LINE_AA);
        } else {
          cv::ellipse(picture, stone, tone, cv::FILLED, cv::LINE_AA);
        }
      }
    }
  }
  for (int k = 0; k < 10; ++k) {  // mended patches, gullies, marks of paint: what tells one stretch from another
    const cv::Size extent(Between(side / 24, side / 7, random), Between(side / 24, side / 7, random));
    const cv::Point corner(Between(0, side - extent.width, random), Between(0, side - extent.height, random));
    if (k % 2) {
      PaintPoster(extent, random)
          .copyTo(picture(cv::Rect(corner, extent)), PaintNoise(extent, 128, 250, extent.width / 3, random) > 110);
    } else {
      const cv::RotatedRect patch(corner, extent, static_cast<float>(random->Uniform(0, 180)));
      cv::ellipse(picture, patch, random->Uniform(50, 190), cv::FILLED, cv::LINE_AA);
    }
  }
  AddGrain(&picture, 0.3, random);
  return picture;
}

cv::Mat PaintPavement(int side, int slabs, Random* random) {
  cv::Mat picture(side, side, CV_8UC1, cv::Scalar(90));
  const int slab = side / slabs, joint = std::max(1, slab / 30);
  for (int row = 0; row < slabs; ++row) {
    for (int column = 0; column < slabs; ++column) {
      const cv::Rect field(column * slab, row * slab, slab - joint, slab - joint);
      cv::rectangle(picture, field, random->Uniform(130, 185), cv::FILLED);
      if (random->Below(6) == 0)
        PaintLettering(&picture, field & cv::Rect(0, 0, side, side), random->Uniform(70, 110), random);
    }
  }
  for (int i = 0; i < 6 * slabs; ++i) {
    const cv::Point centre(Between(0, side, random), Between(0, side, random));
    cv::ellipse(picture, centre, {Between(2, slab / 4, random), Between(2, slab / 6, random)}, random->Uniform(0, 180),
                0, 360, random->Uniform(60, 210), cv::FILLED, cv::LINE_AA);
  }
  AddCracks(&picture, 3 * slabs, 60, random);
  AddGrain(&picture, 0.3, random);
  return picture;
}

cv::Mat PaintPlanks(int side, int boards, Random* random) {
  cv::Mat picture(side, side, CV_8UC1, cv::Scalar(0));
  const int height = (side + boards - 1) / boards;
  for (int board = 0; board < boards; ++board) {
    int x = -Between(0, side / 2, random);
    while (x < side) {
      const int length = Between(side / 3, side / 2, random);
      const double tone = random->Uniform(100, 175);
      const cv::Rect field = cv::Rect(x, board * height, length, height) & cv::Rect(0, 0, side, side);
      cv::rectangle(picture, field, tone, cv::FILLED);
      for (int k = 0; k < 5; ++k) {
        const int y = board * height + Between(2, std::max(3, height - 3), random);
        cv::line(picture, {x + Between(0, length / 2, random), y}, {x + Between(length / 2, length, random), y},
                 tone * 0.8);
      }
      cv::circle(picture, {x + Between(0, length, random), board * height + height / 2}, std::max(1, height / 7),
                 tone * 0.6, cv::FILLED, cv::LINE_AA);
      cv::rectangle(picture, {x, board * height}, {x + length, (board + 1) * height}, tone * 0.55,
                    std::max(1, side / 512));
      x += length;
    }
  }
  AddGrain(&picture, 0.22, random);
  return picture;
}

void PaintLettering(cv::Mat* picture, const cv::Rect& field, double ink, Random* random) {
  const int height = field.height;
  const int stroke = std::max(1, height / 8), width = std::max(3, height * 6 / 10);
  if (height < 5) return;
  for (int x = field.x + stroke; x + width < field.x + field.width; x += width + std::max(2, 2 * stroke)) {
    if (random->Below(6) == 0) continue;  // a space
    for (int k = Between(2, 4, random); k > 0; --k) {
      const cv::Point a(x + width / 2 * Between(0, 2, random),
                        field.y + height / 8 + height * 3 / 8 * Between(0, 2, random));
      const cv::Point b(x + width / 2 * Between(0, 2, random),
                        field.y + height / 8 + height * 3 / 8 * Between(0, 2, random));
      cv::line(*picture, a, b, ink, stroke, cv::LINE_AA);
    }
  }
}

cv::Mat PaintPoster(cv::Size size, Random* random) {
  const double paper = random->Uniform(60, 235);
  cv::Mat picture = PaintNoise(size, paper, 14, 32, random);
  const auto ink = [&] { return paper > 140 ? random->Uniform(10, paper - 50) : random->Uniform(paper + 50, 250); };
  for (int k = Between(3, 7, random); k > 0; --k) {
    const cv::Point a(Between(0, size.width, random), Between(0, size.height, random));
    const int extent = Between(size.width / 12, size.width / 3, random);
    switch (random->Below(4)) {
      case 0:
        cv::rectangle(picture, cv::Rect(a.x, a.y, extent, extent / 2 + 2), ink(), cv::FILLED);
        break;
      case 1:
        cv::circle(picture, a, extent / 2, ink(), cv::FILLED, cv::LINE_AA);
        break;
      case 2:
        cv::line(picture, a, {Between(0, size.width, random), Between(0, size.height, random)}, ink(),
                 std::max(2, size.width / 50), cv::LINE_AA);
        break;
      default: {
        const cv::Point polygon[3] = {a, {a.x + extent, a.y + Between(-extent, extent, random)}, {a.x, a.y + extent}};
        cv::fillConvexPoly(picture, polygon, 3, ink(), cv::LINE_AA);
      }
    }
  }
  for (int line = Between(3, 8, random); line > 0; --line) {
    const int height = Between(std::max(6, size.height / 30), std::max(7, size.height / 8), random);
    const cv::Rect field(size.width / 12, Between(0, std::max(1, size.height - height), random), size.width * 10 / 12,
                         height);
    PaintLettering(&picture, field, ink(), random);
  }
  cv::rectangle(picture, {0, 0}, {size.width - 1, size.height - 1}, ink(), std::max(1, size.width / 60));
  AddGrain(&picture, 0.1, random);
  return picture;
}

cv::Mat PaintBookshelf(int side, int shelves, Random* random) {
  cv::Mat picture(side, side, CV_8UC1, cv::Scalar(45));
  const int height = side / shelves, board = std::max(2, height / 12);
  for (int shelf = 0; shelf < shelves; ++shelf) {
    const int floor = (shelf + 1) * height - board;
    for (int x = 0; x < side;) {
      const int width = Between(height / 12 + 2, height / 4, random),
                book = Between(height / 2, height - board - 2, random);
      if (random->Below(9) > 0) {
        const double tone = random->Uniform(40, 230);
        const cv::Rect back = cv::Rect(x, floor - book, width, book) & cv::Rect(0, 0, side, side);
        cv::rectangle(picture, back, tone, cv::FILLED);
        cv::rectangle(picture, back, tone * 0.5, 1);
        const cv::Rect label = cv::Rect(x + 2, floor - book + Between(2, book / 2, random), width - 3, book / 5) & back;
        if (label.area() > 0) cv::rectangle(picture, label, tone > 130 ? tone - 80 : tone + 80, cv::FILLED);
        cv::line(picture, {x, floor - book / 8}, {x + width, floor - book / 8}, tone > 130 ? 40 : 220,
                 std::max(1, book / 50));
      }
      x += width;
    }
    cv::rectangle(picture, {0, floor}, {side, floor + board}, random->Uniform(120, 160), cv::FILLED);
  }
  AddGrain(&picture, 0.15, random);
  return picture;
}

cv::Mat PaintRoomWall(cv::Size size, Random* random) {
  cv::Mat picture = PaintNoise(size, random->Uniform(150, 190), 40, size.width / 8, random);
  AddCracks(&picture, 24, 90, random);
  PinUp(&picture, 16, 8, 0.3, 0.25, 0.6, random);   // notes
  PinUp(&picture, 8, 3, 0.45, 0.35, 0.85, random);  // pictures
  PinUp(&picture, 20, 10, 0.4, 0.2, 0.5, random);   // notes, also on pictures
  AddGrain(&picture, 0.12, random);
  return picture;
}

}  // namespace portolan
