/** Maps of a study: one figure each over two axes, the first four at once, any other and what a cell shows by choice. */

import { NativeSelect } from "@mantine/core";
import { useState } from "react";
import { Card } from "../../components/Card";
import { fixed } from "../../samples/format";
import { readingOf } from "../../samples/quantity";
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
];

interface MapsCardProps {
  readonly detail: StudyDetail;
  readonly pick: MapPick;
  onPick(pick: MapPick): void;
}

export function MapsCard({ detail, pick, onPick }: MapsCardProps) {
  const [chosen, setChosen] = useState("");
  const named = new Map(detail.figures.map((figure) => [figure.name, figure]));
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
  const figure = detail.figures.find(({ name }) => name === map.figure);
  const { factor, unit } = readingOf(figure?.unit ?? "1", angles);
  const axis = (wanted: string): Axis => {
    const found = detail.axes.find(({ name }) => name === wanted);
    const reading = readingOf(found?.unit ?? "1", angles);
    const values = found?.values ?? [];
    return {
      label: withUnit(SYMBOLS[wanted] ?? wanted, reading.unit),
      values: values.map((value) => (typeof value === "number" ? value * reading.factor : value)),
    };
  };
  const [x, y] = [axis(map.x), axis(map.y)];
  const runs = detail.study.points / (x.values.length * y.values.length);
  const title = withUnit(figure?.label ?? map.figure, unit);
  return (
    <HeatMap
      title={`${title}${runs > 1 ? `: the ${map.pick} of up to ${fixed(runs, 0)} runs` : ""}${
        map.unstable.flat().includes(true) ? "; ∞: a loop is unstable" : ""
      }`}
      x={x}
      y={y}
      cells={map.cells.map((row) => row.map((value) => (value === null ? null : value * factor)))}
      unstable={map.unstable}
    />
  );
}

const SYMBOLS: Record<string, string> = { lam_q: "λ_q", lam_S: "λ_S", lam_motor: "λ_motor" };

function withUnit(words: string, unit: string): string {
  return unit === "1" || unit === "" ? words : `${words} [${unit}]`;
}
