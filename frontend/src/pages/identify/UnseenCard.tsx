/** Models of one kind side by side, each beside data that it was not fitted to. */

import { Checkbox, Fieldset, NativeSelect, Table } from "@mantine/core";
import { useQueries } from "@tanstack/react-query";
import { useState } from "react";
import { Link } from "wouter";
import { type Curve, CurvePlot } from "../../charts/CurvePlot";
import { Card } from "../../components/Card";
import { Explained } from "../../components/Explained";
import { Absent, SignalName, ValueOrReason } from "../../components/values";
import { percent, significant, withError } from "../../samples/format";
import { readingOf } from "../../samples/quantity";
import { unseenQuery } from "../../service/api/identifications";
import { useAngleUnit } from "../../service/api/preferences";
import { HUES } from "../../theme/signals";
import type { Identification, Unseen, UnseenOutput } from "../../wire/types";
import page from "../Page.module.css";
import { candidateOf, change, comparable, describeRecord, outputTitle } from "./ActuatorResult";
import styles from "./Identify.module.css";

const MOST_CANDIDATES = 4;
const MODEL_HUES = ["text", HUES.u_B, HUES.F_B, HUES.u_A] as const;
const MEASURED_HUES: Record<string, string> = { q: HUES.q, S: HUES.S, theta_A: HUES.u_A, theta_B: HUES.u_B };

interface UnseenCardProps {
  readonly identification: Identification;
  readonly all: readonly Identification[];
}

export function UnseenCard({ identification, all }: UnseenCardProps) {
  const others = comparable(identification, all);
  const [beside, setBeside] = useState<ReadonlySet<number>>(new Set());
  const [record, setRecord] = useState(identification.run);
  const shown = [identification, ...others.filter(({ run }) => beside.has(run))];
  const answers = useQueries({ queries: shown.map(({ run }) => unseenQuery(run, record)) });
  const views = answers.map(({ data }) => data);
  const problem = answers.find(({ error }) => error !== null)?.error;

  function toggle(run: number): void {
    const next = new Set(beside);
    if (!next.delete(run)) next.add(run);
    setBeside(next);
  }

  return (
    <Card title="Measured beside model">
      <div className={styles.choices}>
        <NativeSelect
          label="Record to predict"
          value={String(record)}
          onChange={(event) => setRecord(Number(event.currentTarget.value))}
          data={[identification, ...others].map(({ run }) => ({ value: String(run), label: `run ${run}` }))}
        />
        {others.length > 0 && (
          <Fieldset legend="Candidates beside it" variant="unstyled">
            <div className={styles.ticks}>
              {others.map(({ run }) => (
                <Checkbox
                  key={run}
                  size="xs"
                  label={`run ${run}`}
                  aria-label={`Compare run ${run}`}
                  checked={beside.has(run)}
                  disabled={!beside.has(run) && shown.length >= MOST_CANDIDATES}
                  onChange={() => toggle(run)}
                />
              ))}
            </div>
          </Fieldset>
        )}
      </div>
      {problem && <p className={page.empty}>{problem.message}</p>}
      {views[0] === undefined && problem === undefined && <p className={page.empty}>Predicting …</p>}
      {views[0] && (
        <>
          {shown.map(({ run }, index) => {
            const view = views[index];
            return (
              view && (
                <p key={run} className={page.lead}>
                  <Link href={`/identify/${run}`}>Run {run}</Link>:{" "}
                  {describeRecord(view.kind, view.of, view.own)}
                </p>
              )
            );
          })}
          {views[0].outputs.map((output) => (
            <Output key={output.name} name={output.name} shown={shown} views={views} />
          ))}
        </>
      )}
    </Card>
  );
}

interface OutputProps {
  readonly name: string;
  readonly shown: readonly Identification[];
  readonly views: readonly (Unseen | undefined)[];
}

function Output({ name, shown, views }: OutputProps) {
  const angles = useAngleUnit();
  const outputs = views.map((view) => view?.outputs.find((output) => output.name === name));
  const first = outputs[0];
  if (first === undefined) return null;
  const reading = readingOf(first.unit, angles);
  const read = (values: readonly number[]) => values.map((value) => value * reading.factor);
  const title = outputTitle(first);
  return (
    <section className={styles.model} aria-label={`${title} on data not seen`}>
      <h3 className={styles.heading}>{name.startsWith("G_") ? <SignalName name={name} /> : title}</h3>
      <div className={styles.scroll}>
        <Side
          name={name}
          title={title}
          shown={shown}
          outputs={outputs}
          unit={reading.unit}
          factor={reading.factor}
        />
      </div>
      {first.problem !== "" && <p className={page.empty}>{first.problem}</p>}
      <div className={page.halves}>
        <CurvePlot
          title={`${title}: measured and predicted`}
          xLabel={first.name.startsWith("G_") ? "t in the run [s]" : "t from the step [s]"}
          yLabel={reading.unit}
          summary={outputs.map((one, index) => describeFit(shown[index]?.run, one)).join(" ")}
          curves={[
            ...measuredCurves(first, read),
            ...outputs.flatMap((one, index) => predicted(shown[index]?.run, one, index, read)),
          ]}
        />
        <CurvePlot
          title={`${title}: measured minus predicted`}
          xLabel={first.name.startsWith("G_") ? "t in the run [s]" : "t from the step [s]"}
          yLabel={reading.unit}
          summary="What the models leave over."
          curves={outputs.flatMap((one, index) => residuals(shown[index]?.run, one, index, read))}
        />
      </div>
    </section>
  );
}

function describeFit(run: number | undefined, output: UnseenOutput | undefined): string {
  if (output?.fit_percent === null || output === undefined) return `Run ${run}: nothing to compare.`;
  return `Run ${run}: fit ${percent(output.fit_percent, 1)} %.`;
}

type Read = (values: readonly number[]) => number[];

function measuredCurves(output: UnseenOutput, read: Read): Curve[] {
  return output.stretches.map((stretch, index) => ({
    label: "measured",
    quiet: index > 0,
    colour: MEASURED_HUES[output.signal] ?? "text",
    x: stretch.t,
    y: read(stretch.measured),
  }));
}

function predicted(
  run: number | undefined,
  output: UnseenOutput | undefined,
  place: number,
  read: Read,
): Curve[] {
  return (output?.stretches ?? []).map((stretch, index) => ({
    label: `model of run ${run}`,
    quiet: index > 0,
    colour: MODEL_HUES[place] ?? "text",
    line: "dashed",
    x: stretch.t,
    y: read(stretch.predicted),
  }));
}

function residuals(
  run: number | undefined,
  output: UnseenOutput | undefined,
  place: number,
  read: Read,
): Curve[] {
  return (output?.stretches ?? []).map((stretch, index) => ({
    label: `run ${run}`,
    quiet: index > 0,
    colour: MODEL_HUES[place] ?? "text",
    x: stretch.t,
    y: read(stretch.measured.map((value, at) => value - (stretch.predicted[at] ?? Number.NaN))),
  }));
}

interface SideProps {
  readonly name: string;
  readonly title: string;
  readonly shown: readonly Identification[];
  readonly outputs: readonly (UnseenOutput | undefined)[];
  readonly unit: string;
  readonly factor: number;
}

/** One row for each candidate; below each figure how far it is from the first one's. */
function Side({ name, title, shown, outputs, unit, factor }: SideProps) {
  const candidates = shown.map((one) => candidateOf(one, name));
  const first = candidates[0];
  if (first === null || first === undefined) return null;
  return (
    <Table withRowBorders={false} verticalSpacing={2} aria-label={`Candidates of ${title}`}>
      <Table.Thead>
        <Table.Tr>
          <Table.Th>Run</Table.Th>
          {first.estimates.map((one) => (
            <Table.Th key={one.name} className={page.number}>
              <SignalName name={one.name} /> {one.unit !== "1" && `[${one.unit}]`}
            </Table.Th>
          ))}
          <Table.Th className={page.number}>
            <Explained of="quantity:fit_percent">Fit</Explained> [%]
          </Table.Th>
          <Table.Th className={page.number}>Residual, RMS [{unit}]</Table.Th>
          <Table.Th>Grade</Table.Th>
        </Table.Tr>
      </Table.Thead>
      <Table.Tbody>
        {candidates.map((candidate, index) => {
          const output = outputs[index];
          return (
            candidate && (
              <Table.Tr key={candidate.run}>
                <Table.Td>{candidate.run}</Table.Td>
                {candidate.estimates.map((one, at) => (
                  <Table.Td key={one.name} className={page.number}>
                    <span className={styles.together}>
                      {one.std === null ? significant(one.value, 4) : withError(one.value, one.std)}
                      {one.std === null && (
                        <>
                          {" ± "}
                          <Absent why="its standard error was not determined" />
                        </>
                      )}
                    </span>
                    {index > 0 && (
                      <small className={styles.apart}>
                        {change(one.value, first.estimates[at]?.value ?? 0) ?? "nothing to divide by"}
                      </small>
                    )}
                  </Table.Td>
                ))}
                <Table.Td className={page.number}>
                  <ValueOrReason value={output?.fit_percent} why={output?.problem || "being computed"}>
                    {(fit) => percent(fit, 2)}
                  </ValueOrReason>
                </Table.Td>
                <Table.Td className={page.number}>
                  <ValueOrReason value={output?.rms} why={output?.problem || "being computed"}>
                    {(rms) => significant(rms * factor, 3)}
                  </ValueOrReason>
                </Table.Td>
                <Table.Td>
                  <Explained of={`grade:${candidate.grade}`} quiet>
                    {candidate.grade}
                  </Explained>
                </Table.Td>
              </Table.Tr>
            )
          );
        })}
      </Table.Tbody>
    </Table>
  );
}
