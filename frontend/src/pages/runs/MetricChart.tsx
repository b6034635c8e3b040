/** A metric of one kind of runs over the dates of these runs; each point leads to its run. */

import { NativeSelect, TextInput } from "@mantine/core";
import { useDebouncedValue, useElementSize } from "@mantine/hooks";
import { useQuery } from "@tanstack/react-query";
import { useMemo, useState } from "react";
import { TbSearch } from "react-icons/tb";
import { Link } from "wouter";
import { Card } from "../../components/Card";
import { dateTime } from "../../samples/format";
import { readingOf } from "../../samples/quantity";
import { inWordsOf } from "../../samples/words";
import { useAngles } from "../../service/angles";
import { metricHistoryQuery, searchWordsQuery } from "../../service/queries";
import type { MetricHistory } from "../../wire/types";
import page from "../Page.module.css";
import { type Scatter, scatter } from "./metricScatter";
import styles from "./Runs.module.css";

/** What is looked at where nobody has chosen yet. */
const USUAL = "tracking";
const HEIGHT = 520;
/** Beyond so many points they are small, and no line joins them. */
const DENSE = 500;

export function MetricChart() {
  const [kind, setKind] = useState(USUAL);
  const [metric, setMetric] = useState("");
  const [everywhere, setEverywhere] = useState(false);
  const [typed, setTyped] = useState("");
  const [where] = useDebouncedValue(typed, 250);
  const words = useQuery(searchWordsQuery);
  const asked = useQuery(metricHistoryQuery(kind, metric, where, everywhere));
  const data = asked.data?.kind === kind ? asked.data : undefined;
  const kinds = words.data?.kinds ?? [USUAL];
  return (
    <div className={page.page}>
      <h1 className={page.title}>
        <Link href="/runs">Runs</Link> / Metrics over time
      </h1>
      <Card
        title="Metrics over time"
        aside={
          <div className={page.actions}>
            <TextInput
              type="search"
              aria-label="Search runs"
              placeholder="of runs that fit a search"
              leftSection={<TbSearch size={14} />}
              value={typed}
              w={220}
              onChange={(event) => setTyped(event.currentTarget.value)}
            />
            <NativeSelect
              aria-label="Kind"
              value={kind}
              data={kinds.map((value) => ({ value, label: inWordsOf(value) }))}
              onChange={(event) => {
                setKind(event.currentTarget.value);
                setMetric("");
              }}
            />
            <NativeSelect
              aria-label="Metric"
              value={data?.metric?.name ?? ""}
              disabled={data === undefined || data.metrics.length === 0}
              data={(data?.metrics ?? []).map(({ name, label }) => ({ value: name, label }))}
              onChange={(event) => setMetric(event.currentTarget.value)}
            />
            {(words.data?.stations.length ?? 0) > 1 && (
              <NativeSelect
                aria-label="Station"
                value={everywhere ? "all" : ""}
                data={[
                  { value: "", label: "this station" },
                  { value: "all", label: "all stations" },
                ]}
                onChange={(event) => setEverywhere(event.currentTarget.value === "all")}
              />
            )}
          </div>
        }
      >
        {data === undefined || asked.error ? (
          <p className={page.empty}>{asked.error?.message ?? "Loading …"}</p>
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
  const angles = useAngles();
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
  if (history.metric === null) return <p className={page.empty}>No run of this kind has a result yet.</p>;
  const unit = reading.unit === "1" ? "" : ` [${reading.unit}]`;
  return (
    <figure className={styles.chart} aria-label={history.metric.label} ref={ref}>
      <figcaption className={page.dim}>
        {history.metric.label}
        {unit} of {history.points.length} runs
        {history.without > 0 && `; ${history.without} more have no value of it`}
        {history.left_out > 0 && `; ${history.left_out} older ones are left out`}
      </figcaption>
      {/* biome-ignore lint/a11y/useSemanticElements: a fieldset is no part of a drawing */}
      <svg viewBox={`0 0 ${Math.max(width, 1)} ${HEIGHT}`} height={HEIGHT} role="group" aria-label="Points">
        <Axes drawn={drawn} width={width} />
        <path className={styles.line} data-dense={dense} d={drawn.line} />
        {drawn.points.map(({ x, y, run, at, label }) => (
          <Link
            key={run}
            href={`/runs/${run}`}
            aria-label={`Run ${run}: ${label}${unit && ` ${reading.unit}`}`}
          >
            <title>{`Run ${run}, ${dateTime(new Date(at).toISOString())}: ${label}${unit}`}</title>
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
