/** Maps of a study: one figure each over two axes, the first four at once, any other by choice. */

import { NativeSelect } from "@mantine/core";
import { useState } from "react";
import { Card } from "../../components/Card";
import { readingOf } from "../../samples/quantity";
import { useAngles } from "../../service/angles";
import type { StudyDetail, StudyMap } from "../../wire/types";
import page from "../Page.module.css";
import { type Axis, HeatMap } from "./HeatMap";

const AT_ONCE = 4;

export function MapsCard({ detail }: { detail: StudyDetail }) {
  const [chosen, setChosen] = useState("");
  const named = new Map(detail.figures.map((figure) => [figure.name, figure]));
  const others = detail.maps.slice(AT_ONCE);
  const further = others.find(({ figure }) => figure === chosen);
  const shown = further === undefined ? detail.maps.slice(0, AT_ONCE) : [further];
  return (
    <Card
      title="Maps"
      aside={
        <NativeSelect
          aria-label="Figure"
          value={chosen}
          data={[
            { value: "", label: "The usual figures" },
            ...others.map(({ figure }) => ({ value: figure, label: named.get(figure)?.label ?? figure })),
          ]}
          onChange={(event) => setChosen(event.currentTarget.value)}
        />
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
  return (
    <HeatMap
      title={withUnit(figure?.label ?? map.figure, unit)}
      x={axis(map.x)}
      y={axis(map.y)}
      cells={map.cells.map((row) => row.map((value) => (value === null ? null : value * factor)))}
    />
  );
}

const SYMBOLS: Record<string, string> = { lam_q: "λ_q", lam_S: "λ_S", lam_motor: "λ_motor" };

function withUnit(words: string, unit: string): string {
  return unit === "1" || unit === "" ? words : `${words} [${unit}]`;
}
