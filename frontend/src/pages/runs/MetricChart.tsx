import { NativeSelect, TextInput } from "@mantine/core";
import { useDebouncedValue, useElementSize } from "@mantine/hooks";
import { useQuery } from "@tanstack/react-query";
import { useMemo, useState } from "react";
import { TbSearch } from "react-icons/tb";
import { Link } from "wouter";
import { tickLabels } from "../../charts/axes";
import { Card } from "../../components/Card";
import { dateTime, spacedName } from "../../samples/format";
import { readingOf } from "../../samples/quantity";
import { countThings, fillText } from "../../samples/texts";
import { useAngleUnit } from "../../service/api/preferences";
import { metricHistoryQuery, searchWordsQuery } from "../../service/api/runs";
import type { MetricHistory } from "../../wire/types";
import page from "../Page.module.css";
import styles from "./Runs.module.css";
import { TEXTS } from "./texts";

/** Layout of points over dates in pixels, with their axes. Pure. */

interface Point {
  readonly run: number;
  /** Milliseconds since 1970. */
  readonly at: number;
  readonly value: number;
}

interface Tick {
  /** Position on the axis [px]. */
  readonly at: number;
  readonly label: string;
}

interface Scatter {
  /** `label` is the value with a resolution of a tenth of the line spacing. */
  readonly points: readonly (Point & { readonly x: number; readonly y: number; readonly label: string })[];
  /** SVG path through all points. */
  readonly line: string;
  readonly values: readonly Tick[];
  readonly dates: readonly Tick[];
  readonly left: number;
}

const LEFT = 64;
const [RIGHT, TOP, BOTTOM] = [12, 12, 28];
const VALUES = 5;
/** Values with a smaller relative difference count as equal. */
const EVEN = 1e-9;
const DATE_WIDTH = 130;
const MOST_DATES = 6;
const MINUTE_MS = 60_000;
/** Shortest time axis on which dates to the minute differ. */
const SHORTEST_MS = (MOST_DATES - 1) * MINUTE_MS;
const LONGEST_DAY_MS = 25 * 60 * MINUTE_MS;

export function scatter(points: readonly Point[], width: number, height: number): Scatter {
  if (points.length === 0 || width <= LEFT + RIGHT) {
    return { points: [], line: "", values: [], dates: [], left: LEFT };
  }
  const [first, last] = widened(extent(points.map(({ at }) => at)), SHORTEST_MS);
  const values = extent(points.map(({ value }) => value));
  const size = Math.max(...values.map(Math.abs));
  const ticks = steps(...widened(values, values[1] - values[0] > EVEN * size ? 0 : size / 10 || 2), VALUES);
  const [low, high] = [ticks[0] as number, ticks.at(-1) as number];
  const step = (high - low) / (ticks.length - 1);
  const labels = tickLabels(ticks, step);
  const x = (at: number) => LEFT + ((at - first) / (last - first)) * (width - LEFT - RIGHT);
  const y = (value: number) => height - BOTTOM - ((value - low) / (high - low)) * (height - TOP - BOTTOM);
  const placed = points.map((point) => ({
    ...point,
    x: x(point.at),
    y: y(point.value),
    label: tickLabels([point.value], step / 10)[0] as string,
  }));
  const count = Math.max(2, Math.min(MOST_DATES, Math.floor((width - LEFT) / DATE_WIDTH)));
  const dates = Array.from({ length: count }, (_, index) => first + ((last - first) * index) / (count - 1));
  return {
    points: placed,
    line: placed.map((point, index) => `${index === 0 ? "M" : "L"}${point.x},${point.y}`).join(""),
    values: ticks.map((value, place) => ({ at: y(value), label: labels[place] as string })),
    dates: dates.map((at) => ({ at: x(at), label: dated(at, (last - first) / (count - 1)) })),
    left: LEFT,
  };
}

/** Returns the smallest and the largest value. */
function extent(values: readonly number[]): [number, number] {
  const low = values.reduce((least, value) => Math.min(least, value), Number.POSITIVE_INFINITY);
  const high = values.reduce((most, value) => Math.max(most, value), Number.NEGATIVE_INFINITY);
  return [low, high];
}

/** Returns a range with the same centre and at least the length `least`. */
function widened([low, high]: readonly [number, number], least: number): [number, number] {
  const margin = Math.max(0, least - (high - low)) / 2;
  return [low - margin, high + margin];
}

/** Returns evenly spaced round numbers from at most `low` to at least `high`. */
export function steps(low: number, high: number, count: number): number[] {
  const rough = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * ([1, 2, 5, 10].find((factor) => factor * power >= rough) ?? 10);
  const from = Math.floor(low / step);
  const to = Math.ceil(high / step);
  return Array.from({ length: to - from + 1 }, (_, index) => Number(((from + index) * step).toPrecision(12)));
}

/** Returns a date in the local time zone: the day if `step` exceeds any day, else month, day and minute. */
function dated(at: number, step: number): string {
  const text = dateTime(new Date(at).toISOString());
  return step > LONGEST_DAY_MS ? text.slice(0, 10) : text.slice(5, 16);
}

/** Page with a metric of one kind of runs over the dates of the runs; each point links to its run. */

/** Kind of runs shown at first. */
const FIRST_KIND = "tracking";
const HEIGHT = 520;
/** Above this number, points are small and not joined by a line. */
const DENSE = 500;

export function MetricChart() {
  const [kind, setKind] = useState(FIRST_KIND);
  const [metric, setMetric] = useState("");
  const [everywhere, setEverywhere] = useState(false);
  const [typed, setTyped] = useState("");
  const [where] = useDebouncedValue(typed, 250);
  const words = useQuery(searchWordsQuery);
  const asked = useQuery(metricHistoryQuery(kind, metric, where, everywhere));
  const data = asked.data?.kind === kind ? asked.data : undefined;
  const kinds = words.data?.kinds ?? [FIRST_KIND];
  return (
    <div className={page.page}>
      <h1 className={page.title}>
        <Link href="/runs">{TEXTS.runs}</Link> / {TEXTS.metricsOverTime}
      </h1>
      <Card
        title={TEXTS.metricsOverTime}
        aside={
          <div className={page.actions}>
            <TextInput
              type="search"
              aria-label={TEXTS.searchRuns}
              placeholder={TEXTS.searchHintOfMetrics}
              leftSection={<TbSearch size={14} />}
              value={typed}
              w={220}
              onChange={(event) => setTyped(event.currentTarget.value)}
            />
            <NativeSelect
              aria-label={TEXTS.kind}
              value={kind}
              data={kinds.map((value) => ({ value, label: spacedName(value) }))}
              onChange={(event) => {
                setKind(event.currentTarget.value);
                setMetric("");
              }}
            />
            <NativeSelect
              aria-label={TEXTS.metric}
              value={data?.metric?.name ?? ""}
              disabled={data === undefined || data.metrics.length === 0}
              data={(data?.metrics ?? []).map(({ name, label }) => ({ value: name, label }))}
              onChange={(event) => setMetric(event.currentTarget.value)}
            />
            {(words.data?.stations.length ?? 0) > 1 && (
              <NativeSelect
                aria-label={TEXTS.station}
                value={everywhere ? "all" : ""}
                data={[
                  { value: "", label: TEXTS.thisStation },
                  { value: "all", label: TEXTS.allStations },
                ]}
                onChange={(event) => setEverywhere(event.currentTarget.value === "all")}
              />
            )}
          </div>
        }
      >
        {data === undefined || asked.error ? (
          <p className={page.empty}>{asked.error?.message ?? TEXTS.loading}</p>
        ) : (
          <div className={styles.answer} aria-busy={asked.isPlaceholderData}>
            <Chart history={data} />
          </div>
        )}
      </Card>
    </div>
  );
}

function Chart({ history }: { history: MetricHistory }) {
  const { ref, width } = useElementSize();
  const angles = useAngleUnit();
  const reading = readingOf(history.metric?.unit ?? "1", angles);
  const drawn = useMemo(
    () =>
      scatter(
        history.points.map(({ run, at, value }) => ({
          run,
          at: Date.parse(at),
          value: value * reading.factor,
        })),
        width,
        HEIGHT,
      ),
    [history, reading.factor, width],
  );
  const dense = history.points.length > DENSE;
  if (history.metric === null) return <p className={page.empty}>{TEXTS.noResultOfKind}</p>;
  const unit = reading.unit === "1" ? "" : ` [${reading.unit}]`;
  return (
    <figure className={styles.chart} aria-label={history.metric.label} ref={ref}>
      <figcaption className={page.dim}>
        {fillText(TEXTS.pointsShown, {
          metric: `${history.metric.label}${unit}`,
          runs: countThings(history.points.length, "run"),
        })}
        {history.without > 0 && fillText(TEXTS.withoutValue, { runs: countThings(history.without, "run") })}
        {history.left_out > 0 &&
          fillText(TEXTS.olderOmitted, { runs: countThings(history.left_out, TEXTS.olderRun) })}
      </figcaption>
      {/* biome-ignore lint/a11y/useSemanticElements: an SVG cannot be a fieldset */}
      <svg
        viewBox={`0 0 ${Math.max(width, 1)} ${HEIGHT}`}
        height={HEIGHT}
        role="group"
        aria-label={TEXTS.points}
      >
        <Axes drawn={drawn} width={width} />
        <path className={styles.line} data-dense={dense} d={drawn.line} />
        {drawn.points.map(({ x, y, run, at, label }) => (
          <Link
            key={run}
            href={`/runs/${run}`}
            aria-label={fillText(TEXTS.pointLabel, { run, value: `${label}${unit && ` ${reading.unit}`}` })}
          >
            <title>
              {fillText(TEXTS.pointTitle, {
                run,
                time: dateTime(new Date(at).toISOString()),
                value: `${label}${unit}`,
              })}
            </title>
            <circle className={styles.point} cx={x} cy={y} r={dense ? 2 : 4} />
          </Link>
        ))}
      </svg>
    </figure>
  );
}

function Axes({ drawn, width }: { drawn: Scatter; width: number }) {
  return (
    <g>
      {drawn.values.map(({ at, label }) => (
        <g key={at}>
          <line className={styles.grid} x1={drawn.left} x2={width} y1={at} y2={at} />
          <text className={styles.tick} x={drawn.left - 6} y={at + 4} textAnchor="end">
            {label}
          </text>
        </g>
      ))}
      {drawn.dates.map(({ at, label }, index) => (
        <text
          key={at}
          className={styles.tick}
          x={at}
          y={HEIGHT - 6}
          textAnchor={index === 0 ? "start" : index === drawn.dates.length - 1 ? "end" : "middle"}
        >
          {label}
        </text>
      ))}
    </g>
  );
}
