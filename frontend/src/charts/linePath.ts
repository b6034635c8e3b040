/** Path of a curve straight from typed arrays; NaN lifts the pen, so that missing samples show as holes. */

import type uPlot from "uplot";

const NO_FLAGS = 0;

export function linePath(plot: uPlot, series: number, first: number, last: number): uPlot.Series.Paths {
  const stroke = new Path2D();
  const times = plot.data[0] as ArrayLike<number>;
  const values = plot.data[series] as ArrayLike<number>;
  const x = plot.scales.x as uPlot.Scale;
  const y = plot.scales.y as uPlot.Scale;
  const { left, top, width, height } = plot.bbox;
  const perSecond = width / ((x.max ?? 1) - (x.min ?? 0));
  const perUnit = height / ((y.max ?? 1) - (y.min ?? 0));
  const originX = left - (x.min ?? 0) * perSecond;
  const originY = top + height + (y.min ?? 0) * perUnit;
  const end = Math.min(last + 1, times.length - 1);
  let down = false;
  let level = Number.NaN;
  let skipped = Number.NaN;
  for (let index = Math.max(0, first - 1); index <= end; index++) {
    const value = values[index] as number;
    const px = originX + (times[index] as number) * perSecond;
    // along a level stretch only its two ends matter; dashes and strokes cost by the point
    if (value === level) {
      skipped = px;
      continue;
    }
    if (!Number.isNaN(skipped)) stroke.lineTo(skipped, originY - level * perUnit);
    skipped = Number.NaN;
    level = value;
    if (Number.isNaN(value)) {
      down = false;
      continue;
    }
    const py = originY - value * perUnit;
    if (down) stroke.lineTo(px, py);
    else stroke.moveTo(px, py);
    down = true;
  }
  if (!Number.isNaN(skipped)) stroke.lineTo(skipped, originY - level * perUnit);
  return { stroke, fill: null, clip: null, flags: NO_FLAGS };
}
