import { NativeSelect } from "@mantine/core";
import { useState } from "react";
import { Card } from "../../components/Card";
import { digitsApart, digitsOver, fixed, settingValue, short } from "../../samples/format";
import { readingOf } from "../../samples/quantity";
import { countThings, fillText } from "../../samples/texts";
import { useAngleUnit } from "../../service/api/preferences";
import type { MapPick } from "../../service/api/studies";
import type { StudyDetail, StudyMap } from "../../wire/types";
import pageStyles from "../Page.module.css";
import studiesStyles from "./Studies.module.css";
import { TEXTS } from "./texts";

/** Layout and colours of the cells of a map. */

type Cells = readonly (readonly (number | null)[])[];

interface Cell {
  readonly key: string;
  readonly row: number;
  readonly column: number;
  readonly value: number | null;
  readonly left: number;
  readonly top: number;
  readonly width: number;
  readonly height: number;
  /** null without a number. */
  readonly colour: string | null;
  /** Colour of the number in the cell. */
  readonly ink: string;
  readonly text: string;
}

/** Colour scale viridis: even steps of lightness, which colour-blind people can distinguish. */
const STOPS = [
  [68, 1, 84],
  [59, 82, 139],
  [33, 145, 140],
  [94, 201, 98],
  [253, 231, 37],
] as const;

/** A smaller cell shows no number [px]. */
const NUMBER_LEAST_X = 34;
const NUMBER_LEAST_Y = 14;
const MOST_TICKS = 8;

/** Least range of the colours relative to the largest magnitude, so that similar values look similar. */
const LEAST_RANGE = 0.05;

/** Returns the colour of a share from 0 to 1. */
export function colourOf(share: number): string {
  return `rgb(${partsOf(share).join(" ")})`;
}

/** Returns black or white for a text on the colour of a share, whichever has more contrast (WCAG 2.1). */
export function inkOf(share: number): string {
  const [red = 0, green = 0, blue = 0] = partsOf(share).map((part) => {
    const value = part / 255;
    return value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4;
  });
  const luminance = 0.2126 * red + 0.7152 * green + 0.0722 * blue;
  return (luminance + 0.05) ** 2 > 1.05 * 0.05 ? "#000000" : "#ffffff";
}

/** Returns the least and the largest value, or a wider range if these are similar, for the colour scale. */
export function colourRange(values: readonly number[]): [number, number] {
  const [low, high] = values.length === 0 ? [0, 1] : [Math.min(...values), Math.max(...values)];
  const wide = LEAST_RANGE * Math.max(Math.abs(low), Math.abs(high));
  if (high - low >= wide && high > low) return [low, high];
  const half = wide > 0 ? wide / 2 : 0.5;
  return [(low + high) / 2 - half, (low + high) / 2 + half];
}

/** Returns red, green and blue from 0 to 255. */
function partsOf(share: number): number[] {
  const at = Math.min(1, Math.max(0, share)) * (STOPS.length - 1);
  const low = Math.min(STOPS.length - 2, Math.floor(at));
  const [from, to] = [STOPS[low] ?? STOPS[0], STOPS[low + 1] ?? STOPS[0]];
  return from.map((part, place) => Math.round(part + (at - low) * ((to[place] ?? part) - part)));
}

/** Returns the cells of a map of `width` by `height` [px], with the first row at the bottom. */
export function cellsOf(cells: Cells, width: number, height: number) {
  const known = cells.flat().filter((value) => value !== null);
  const [low, high] = colourRange(known);
  const digits = digitsOver(known);
  const cellHeight = height / cells.length;
  const drawn = cells.flatMap((row, y) => {
    const cellWidth = width / row.length;
    return row.map((value, x): Cell => {
      const share = value === null ? 0 : (value - low) / (high - low);
      return {
        key: `${y} ${x}`,
        row: y,
        column: x,
        value,
        left: x * cellWidth,
        top: height - (y + 1) * cellHeight,
        width: cellWidth,
        height: cellHeight,
        colour: value === null ? null : colourOf(share),
        ink: value === null ? "var(--text)" : inkOf(share),
        text:
          value === null || cellWidth < NUMBER_LEAST_X || cellHeight < NUMBER_LEAST_Y
            ? ""
            : short(value, digits),
      };
    });
  });
  return { range: known.length === 0 ? null : ([low, high] as const), digits, drawn };
}

/** Returns the indices of the values that an axis with `count` values labels. */
export function ticksOf(count: number): number[] {
  const step = Math.ceil(count / MOST_TICKS);
  return Array.from({ length: Math.ceil(count / step) }, (_, place) => place * step);
}

/** Picture of a map: a coloured cell for each pair of values, and the colour scale. */

interface Axis {
  readonly label: string;
  readonly values: readonly (number | string | boolean)[];
}

interface HeatMapProps {
  readonly title: string;
  readonly x: Axis;
  readonly y: Axis;
  /** Indexed by y, then by x. */
  readonly cells: Cells;
  /** Cells without a number because the loop of a run is unstable; same indices. */
  readonly unstable: readonly (readonly boolean[])[];
  /** Number of runs of each cell, and the interval of a share; "" for one run per cell; same indices. */
  readonly notes: readonly (readonly string[])[];
}

const WIDTH = 420;
const HEIGHT = 300;
const LEFT = 62;
const BOTTOM = 40;
const SCALE = 96;
const TOP = 8;
/** Half the distance of a number and the note below it, and the least size of a cell with both [px]. */
const APART = 7;
const NOTE_LEAST_X = 62;
const NOTE_LEAST_Y = 30;

function HeatMap({ title, x, y, cells, unstable, notes }: HeatMapProps) {
  const width = WIDTH - LEFT - SCALE;
  const height = HEIGHT - TOP - BOTTOM;
  const { range, digits, drawn } = cellsOf(cells, width, height);
  const noteOf = ({ row, column }: Cell) => notes[row]?.[column] ?? "";
  const isNoted = (cell: Cell) =>
    noteOf(cell) !== "" && cell.width >= NOTE_LEAST_X && cell.height >= NOTE_LEAST_Y;
  const textAt = (cell: Cell) => cell.top + cell.height / 2 - (isNoted(cell) ? APART : 0);
  const [namesX, namesY] = [namesOf(x), namesOf(y)];
  const describeCell = (cell: Cell): string => {
    const { row, column, value } = cell;
    const cellTexts = {
      x: x.label,
      atX: namesX[column] ?? "",
      y: y.label,
      atY: namesY[row] ?? "",
      value: value !== null ? short(value, digits) : unstable[row]?.[column] ? TEXTS.unstable : TEXTS.noValue,
    };
    const note = noteOf(cell);
    return note === ""
      ? fillText(TEXTS.cell, cellTexts)
      : fillText(TEXTS.cellWithNote, { ...cellTexts, note });
  };
  const atX = (place: number) => LEFT + ((place + 0.5) * width) / x.values.length;
  const atY = (place: number) => TOP + height - ((place + 0.5) * height) / y.values.length;
  return (
    <figure className={studiesStyles.map} aria-label={title}>
      <figcaption>{title}</figcaption>
      <svg
        viewBox={`0 0 ${WIDTH} ${HEIGHT}`}
        role="img"
        aria-label={fillText(TEXTS.mapOver, { title, x: x.label, y: y.label })}
      >
        <g transform={`translate(${LEFT} ${TOP})`}>
          {drawn.map((cell) => (
            <g key={cell.key}>
              <rect
                x={cell.left}
                y={cell.top}
                width={cell.width}
                height={cell.height}
                fill={cell.colour ?? "var(--sunken)"}
              >
                <title>{describeCell(cell)}</title>
              </rect>
              {unstable[cell.row]?.[cell.column] && (
                <text
                  x={cell.left + cell.width / 2}
                  y={textAt(cell)}
                  className={studiesStyles.inside}
                  fill="var(--text)"
                >
                  ∞
                </text>
              )}
              {cell.text !== "" && (
                <text
                  x={cell.left + cell.width / 2}
                  y={textAt(cell)}
                  className={studiesStyles.inside}
                  fill={cell.ink}
                >
                  {cell.text}
                </text>
              )}
              {isNoted(cell) && (
                <text
                  x={cell.left + cell.width / 2}
                  y={cell.top + cell.height / 2 + APART}
                  className={studiesStyles.note}
                  fill={cell.ink}
                >
                  {noteOf(cell)}
                </text>
              )}
            </g>
          ))}
        </g>
        {ticksOf(x.values.length).map((place) => (
          <text
            key={place}
            x={atX(place)}
            y={HEIGHT - BOTTOM + 14}
            className={studiesStyles.tick}
            textAnchor="middle"
          >
            {namesX[place]}
          </text>
        ))}
        {ticksOf(y.values.length).map((place) => (
          <text
            key={place}
            x={LEFT - 6}
            y={atY(place)}
            dy="0.35em"
            className={studiesStyles.tick}
            textAnchor="end"
          >
            {namesY[place]}
          </text>
        ))}
        <text x={LEFT + width / 2} y={HEIGHT - 6} className={studiesStyles.label} textAnchor="middle">
          {x.label}
        </text>
        <text
          transform={`translate(12 ${TOP + height / 2}) rotate(-90)`}
          className={studiesStyles.label}
          textAnchor="middle"
        >
          {y.label}
        </text>
        {range !== null && <Scale left={WIDTH - SCALE + 16} height={height} range={range} digits={digits} />}
      </svg>
    </figure>
  );
}

/** Colour scale with its least and largest value. */
function Scale({
  left,
  height,
  range: [low, high],
  digits,
}: {
  left: number;
  height: number;
  range: readonly [number, number];
  digits: number;
}) {
  const steps = Array.from({ length: 24 }, (_, step) => step / 23);
  const { drawn } = cellsOf(
    steps.map((step) => [step]),
    12,
    height,
  );
  return (
    <g transform={`translate(${left} ${TOP})`}>
      {drawn.map((cell) => (
        <rect
          key={cell.key}
          y={cell.top}
          width={12}
          height={cell.height + 0.5}
          fill={cell.colour ?? "none"}
        />
      ))}
      <text x={18} y={8} className={studiesStyles.tick}>
        {short(high, digits)}
      </text>
      <text x={18} y={height} className={studiesStyles.tick}>
        {short(low, digits)}
      </text>
    </g>
  );
}

/** Returns distinct labels for the values of an axis. */
function namesOf({ values }: Axis): string[] {
  const digits = digitsApart(values.filter((value) => typeof value === "number"));
  return values.map((value) => (typeof value === "number" ? short(value, digits) : settingValue(value)));
}

/** Card with the first four maps of a study or a selected one, and the choice of the cells' statistic. */

const AT_ONCE = 4;
const PICKS: readonly { value: MapPick; label: string }[] = [
  { value: "worst", label: TEXTS.worst },
  { value: "mean", label: TEXTS.mean },
  { value: "least", label: TEXTS.least },
  { value: "largest", label: TEXTS.largest },
  { value: "deviation", label: TEXTS.deviation },
  { value: "p5", label: TEXTS.p5 },
  { value: "median", label: TEXTS.median },
  { value: "p95", label: TEXTS.p95 },
];
const PICK_WORDS = new Map<string, string>(PICKS.map(({ value, label }) => [value, label]));

interface MapsCardProps {
  readonly detail: StudyDetail;
  readonly pick: MapPick;
  onPick(pick: MapPick): void;
}

export function MapsCard({ detail, pick, onPick }: MapsCardProps) {
  const [chosen, setChosen] = useState("");
  const named = new Map([...detail.figures, ...detail.shares].map((figure) => [figure.name, figure]));
  const others = detail.maps.slice(AT_ONCE);
  const further = others.find(({ figure }) => figure === chosen);
  const shown = further === undefined ? detail.maps.slice(0, AT_ONCE) : [further];
  return (
    <Card
      title={TEXTS.maps}
      aside={
        <div className={pageStyles.actions}>
          <NativeSelect
            aria-label={TEXTS.cellValue}
            value={pick}
            data={PICKS.map(({ value, label }) => ({
              value,
              label: fillText(TEXTS.cellValueIs, { statistic: label }),
            }))}
            onChange={(event) => onPick(event.currentTarget.value as MapPick)}
          />
          <NativeSelect
            aria-label={TEXTS.metric}
            value={chosen}
            data={[
              { value: "", label: TEXTS.defaultMetrics },
              ...others.map(({ figure }) => ({ value: figure, label: named.get(figure)?.label ?? figure })),
            ]}
            onChange={(event) => setChosen(event.currentTarget.value)}
          />
        </div>
      }
    >
      <div className={pageStyles.halves}>
        {shown.map((map) => (
          <FigureMap key={map.figure} map={map} detail={detail} />
        ))}
      </div>
    </Card>
  );
}

function FigureMap({ map, detail }: { map: StudyMap; detail: StudyDetail }) {
  const angles = useAngleUnit();
  const share = detail.shares.find(({ name }) => name === map.figure);
  const figure = detail.figures.find(({ name }) => name === map.figure);
  const { factor, unit } = readingOf(share === undefined ? (figure?.unit ?? "1") : "%", angles);
  const axis = (wanted: string): Axis => {
    const found = detail.axes.find(({ name }) => name === wanted);
    const reading = readingOf(found?.unit ?? "1", angles);
    const values = found?.values ?? [];
    return {
      label: withUnit(found?.symbol ?? wanted, reading.unit),
      values: values.map((value) => (typeof value === "number" ? value * reading.factor : value)),
    };
  };
  const [x, y] = [axis(map.x), axis(map.y)];
  const runs = detail.study.points / (x.values.length * y.values.length);
  const title = withUnit(share?.label ?? figure?.label ?? map.figure, unit);
  const statistic = share === undefined ? (PICK_WORDS.get(map.pick) ?? map.pick) : TEXTS.share;
  const computed = sum(map.runs);
  const without = computed - sum(map.counts);
  return (
    <HeatMap
      title={[
        runs > 1 ? fillText(TEXTS.mapOf, { metric: title, statistic, count: fixed(runs, 0) }) : title,
        ...(map.unstable.flat().includes(true) ? [TEXTS.mapUnstable] : []),
        ...(without > 0
          ? [
              fillText(TEXTS.mapWithout, {
                without: fixed(without, 0),
                runs: countThings(computed, TEXTS.runCount),
              }),
            ]
          : []),
      ].join("; ")}
      x={x}
      y={y}
      cells={map.cells.map((row) => row.map((value) => (value === null ? null : value * factor)))}
      unstable={map.unstable}
      notes={map.runs.map((row, y) => row.map((_, x) => noteOf(map, y, x, runs)))}
    />
  );
}

/** Returns the note of a cell: its number of runs, and the interval of a share. */
function noteOf(map: StudyMap, row: number, column: number, runs: number): string {
  const [count, computed] = [map.counts[row]?.[column] ?? 0, map.runs[row]?.[column] ?? 0];
  const interval = map.intervals[row]?.[column];
  if (interval) {
    const [low, high] = interval.map((end) => short(end, 3));
    return fillText(TEXTS.noteInterval, {
      interval: fillText(TEXTS.interval, { low: low ?? "", high: high ?? "" }),
      count: fixed(count, 0),
    });
  }
  if (runs <= 1) return "";
  return count < computed
    ? fillText(TEXTS.noteCountOf, { count: fixed(count, 0), runs: fixed(computed, 0) })
    : fillText(TEXTS.noteCount, { count: fixed(count, 0) });
}

function sum(table: readonly (readonly number[])[]): number {
  return table.flat().reduce((all, each) => all + each, 0);
}

function withUnit(words: string, unit: string): string {
  return unit === "1" || unit === "" ? words : `${words} [${unit}]`;
}
