/** Static plot of curves and points, which may have different x values, in the theme's colours. */

import { useComputedColorScheme } from "@mantine/core";
import { useElementSize } from "@mantine/hooks";
import { useEffect, useRef } from "react";
import uPlot from "uplot";
import { paintOf } from "../theme/signals";
import { logLabels, tickLabels } from "./axes";
import styles from "./CurvePlot.module.css";
import { type ChartColours, readColours } from "./canvas";

const FONT = "11px system-ui, -apple-system, 'Segoe UI', Roboto, sans-serif";
const LINE_WIDTH = 1.6;

export interface Curve {
  readonly label: string;
  readonly x: readonly number[];
  readonly y: readonly (number | null)[];
  /** A hue, or "text" and "limit" for the theme's colours. */
  readonly colour: string;
  readonly line?: "solid" | "dashed" | "none";
  readonly points?: boolean;
  /** Whether the key below the title omits the curve, because another curve represents it. */
  readonly quiet?: boolean;
}

interface CurvePlotProps {
  readonly title: string;
  readonly xLabel: string;
  readonly yLabel: string;
  readonly curves: readonly Curve[];
  readonly height?: number;
  readonly xLog?: boolean;
  readonly yLog?: boolean;
  /** Description of the plot for screen readers. */
  readonly summary: string;
}

export function CurvePlot(props: CurvePlotProps) {
  const { title, curves, height = 180, summary } = props;
  const { ref, width } = useElementSize();
  const host = useRef<HTMLDivElement>(null);
  const scheme = useComputedColorScheme("light");

  // biome-ignore lint/correctness/useExhaustiveDependencies: another colour scheme has other colours
  useEffect(() => {
    const element = host.current;
    if (element === null || width === 0) return;
    const colours = readColours(element);
    const tables = curves.map((curve) => [[...curve.x], [...curve.y]] as unknown as uPlot.AlignedData);
    const data = uPlot.join(tables) as uPlot.AlignedData;
    const plot = new uPlot(configuration(props, colours, width, height), data, element);
    return () => plot.destroy();
  }, [props.curves, props.xLabel, props.yLabel, width, height, scheme]);

  return (
    <figure className={styles.figure} aria-label={title}>
      <figcaption className={styles.caption}>
        <span className={styles.title}>{title}</span>
        {curves
          .filter((curve) => !curve.quiet)
          .map((curve) => (
            <span key={curve.label} className={styles.key}>
              <Key curve={curve} />
              {curve.label}
            </span>
          ))}
        <span className="visually-hidden">{summary}</span>
      </figcaption>
      <div ref={ref} className={styles.canvas} style={{ height }} aria-hidden="true">
        <div ref={host} />
      </div>
    </figure>
  );
}

function Key({ curve }: { curve: Curve }) {
  const stroke = { text: "var(--text)", limit: "var(--chart-limit)" }[curve.colour] ?? paintOf(curve.colour);
  return (
    <svg width="18" height="8" aria-hidden="true">
      {curve.line !== "none" && (
        <line
          x1="0"
          x2="18"
          y1="4"
          y2="4"
          stroke={stroke}
          strokeWidth="2"
          strokeDasharray={curve.line === "dashed" ? "5 3" : undefined}
        />
      )}
      {curve.points && <circle cx="9" cy="4" r="2.5" fill={stroke} />}
    </svg>
  );
}

function configuration(
  props: CurvePlotProps,
  colours: ChartColours,
  width: number,
  height: number,
): uPlot.Options {
  const grid = { stroke: colours.grid, width: 1 };
  const axis: uPlot.Axis = {
    stroke: colours.axis,
    font: FONT,
    labelFont: FONT,
    grid,
    ticks: { show: false },
    gap: 4,
  };
  const linear: uPlot.Axis.DynamicValues = (_plot, splits, _axis, _space, step) => tickLabels(splits, step);
  const logarithmic: uPlot.Axis.DynamicValues = (_plot, splits) => logLabels(splits);
  const labels = (log = false) => ({ values: log ? logarithmic : linear });
  return {
    width,
    height,
    padding: [6, 10, 0, 0],
    legend: { show: false },
    cursor: { show: false },
    scales: {
      x: { time: false, ...(props.xLog ? { distr: 3 } : {}) },
      y: props.yLog ? { distr: 3 } : {},
    },
    series: [{}, ...props.curves.map((curve) => seriesOf(curve, colours))],
    axes: [
      { ...axis, ...labels(props.xLog), label: props.xLabel, labelSize: 16, size: 22, space: 60 },
      { ...axis, ...labels(props.yLog), label: props.yLabel, labelSize: 16, size: 50, space: 28 },
    ],
  };
}

function seriesOf(curve: Curve, colours: ChartColours): uPlot.Series {
  const colour = { text: colours.text, limit: colours.limit }[curve.colour] ?? colours.drawn(curve.colour);
  return {
    stroke: colour,
    width: curve.line === "none" ? 0 : LINE_WIDTH,
    spanGaps: true,
    ...(curve.line === "dashed" ? { dash: [6, 4] } : {}),
    points: { show: curve.points === true, size: 4, width: 0, fill: colour },
  };
}
