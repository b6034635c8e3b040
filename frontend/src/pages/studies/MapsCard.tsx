/** Maps of a study: one figure each over two axes, the first four at once, any other and what a cell shows by choice. */

import { NativeSelect } from "@mantine/core";
import { useState } from "react";
import { Card } from "../../components/Card";
import { fixed, short } from "../../samples/format";
import { readingOf } from "../../samples/quantity";
import { counted } from "../../samples/words";
import { useAngles } from "../../service/angles";
import type { MapPick } from "../../service/studies";
import type { StudyDetail, StudyMap } from "../../wire/types";
import page from "../Page.module.css";
import { type Axis, HeatMap } from "./HeatMap";

const AT_ONCE = 4;
const PICKS: readonly { value: MapPick; label: string }[] = [
  { value: "worst", label: "the worst run" },
  { value: "mean", label: "the mean" },
  { value: "least", label: "the least" },
  { value: "largest", label: "the largest" },
  { value: "deviation", label: "the standard deviation" },
  { value: "p5", label: "the 5 % percentile" },
  { value: "median", label: "the median" },
  { value: "p95", label: "the 95 % percentile" },
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
      title="Maps"
      aside={
        <div className={page.actions}>
          <NativeSelect
            aria-label="Each cell"
            value={pick}
            data={PICKS.map(({ value, label }) => ({ value, label: `each cell: ${label}` }))}
            onChange={(event) => onPick(event.currentTarget.value as MapPick)}
          />
          <NativeSelect
            aria-label="Figure"
            value={chosen}
            data={[
              { value: "", label: "The usual figures" },
              ...others.map(({ figure }) => ({ value: figure, label: named.get(figure)?.label ?? figure })),
            ]}
            onChange={(event) => setChosen(event.currentTarget.value)}
          />
        </div>
      }
    >
      <div className={page.halves}>
        {shown.map((map) => (
          <FigureMap key={map.figure} map={map} detail={detail} />
        ))}
      </div>
    </Card>
  );
}

function FigureMap({ map, detail }: { map: StudyMap; detail: StudyDetail }) {
  const angles = useAngles();
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
  const several = share === undefined ? (PICK_WORDS.get(map.pick) ?? `the ${map.pick}`) : "the share";
  const computed = sum(map.runs);
  const without = computed - sum(map.counts);
  return (
    <HeatMap
      title={[
        `${title}${runs > 1 ? `: ${several} of up to ${fixed(runs, 0)} runs` : ""}`,
        ...(map.unstable.flat().includes(true) ? ["∞: a loop is unstable"] : []),
        ...(without > 0 ? [`${fixed(without, 0)} of ${counted(computed, "run")} without a number`] : []),
      ].join("; ")}
      x={x}
      y={y}
      cells={map.cells.map((row) => row.map((value) => (value === null ? null : value * factor)))}
      unstable={map.unstable}
      notes={map.runs.map((row, y) => row.map((_, x) => noteOf(map, y, x, runs)))}
    />
  );
}

/** Of which runs a cell is; of a share between what it lies, too. */
function noteOf(map: StudyMap, row: number, column: number, runs: number): string {
  const [count, computed] = [map.counts[row]?.[column] ?? 0, map.runs[row]?.[column] ?? 0];
  const interval = map.intervals[row]?.[column];
  if (interval) return `${interval.map((end) => short(end, 3)).join(" to ")}, n = ${fixed(count, 0)}`;
  return runs > 1 ? `n = ${fixed(count, 0)}${count < computed ? ` of ${fixed(computed, 0)}` : ""}` : "";
}

function sum(table: readonly (readonly number[])[]): number {
  return table.flat().reduce((all, each) => all + each, 0);
}

function withUnit(words: string, unit: string): string {
  return unit === "1" || unit === "" ? words : `${words} [${unit}]`;
}
