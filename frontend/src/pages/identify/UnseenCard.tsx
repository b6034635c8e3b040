/** Comparison of models of one kind on data that they were not fitted to. */

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
import { fillText } from "../../samples/texts";
import { unseenQuery } from "../../service/api/identifications";
import { useAngleUnit } from "../../service/api/preferences";
import { HUES } from "../../theme/signals";
import type { Identification, Unseen, UnseenOutput } from "../../wire/types";
import page from "../Page.module.css";
import { candidateOf, change, comparable, describeRecord, outputTitle } from "./ActuatorResult";
import styles from "./Identify.module.css";
import { TEXTS } from "./texts";

const MOST_CANDIDATES = 4;
const MODEL_HUES = ["text", HUES.u_B, HUES.F_B, HUES.u_A] as const;
const MEASURED_HUES: Record<string, string> = { q: HUES.q, S: HUES.S, theta_A: HUES.u_A, theta_B: HUES.u_B };

interface UnseenCardProps {
  readonly identification: Identification;
  readonly all: readonly Identification[];
}

export function UnseenCard({ identification, all }: UnseenCardProps) {
  const others = comparable(identification, all);
  const [compared, setCompared] = useState<ReadonlySet<number>>(new Set());
  const [record, setRecord] = useState(identification.run);
  const shown = [identification, ...others.filter(({ run }) => compared.has(run))];
  const answers = useQueries({ queries: shown.map(({ run }) => unseenQuery(run, record)) });
  const views = answers.map(({ data }) => data);
  const problem = answers.find(({ error }) => error !== null)?.error;

  function toggle(run: number): void {
    const next = new Set(compared);
    if (!next.delete(run)) next.add(run);
    setCompared(next);
  }

  return (
    <Card title={TEXTS.validation}>
      <div className={styles.choices}>
        <NativeSelect
          label={TEXTS.validationData}
          value={String(record)}
          onChange={(event) => setRecord(Number(event.currentTarget.value))}
          data={[identification, ...others].map(({ run }) => ({
            value: String(run),
            label: fillText(TEXTS.runItem, { run }),
          }))}
        />
        {others.length > 0 && (
          <Fieldset legend={TEXTS.compareWith} variant="unstyled">
            <div className={styles.ticks}>
              {others.map(({ run }) => (
                <Checkbox
                  key={run}
                  size="xs"
                  label={fillText(TEXTS.runItem, { run })}
                  aria-label={fillText(TEXTS.compareRun, { run })}
                  checked={compared.has(run)}
                  disabled={!compared.has(run) && shown.length >= MOST_CANDIDATES}
                  onChange={() => toggle(run)}
                />
              ))}
            </div>
          </Fieldset>
        )}
      </div>
      {problem && <p className={page.empty}>{problem.message}</p>}
      {views[0] === undefined && problem === undefined && <p className={page.empty}>{TEXTS.predicting}</p>}
      {views[0] && (
        <>
          {shown.map(({ run }, index) => {
            const view = views[index];
            return (
              view && (
                <p key={run} className={page.lead}>
                  <Link href={`/identify/${run}`}>{fillText(TEXTS.runLink, { run })}</Link>:{" "}
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
  const time = first.name.startsWith("G_") ? TEXTS.timeInRun : TEXTS.timeFromStep;
  return (
    <section className={styles.model} aria-label={fillText(TEXTS.onData, { title })}>
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
          title={fillText(TEXTS.measuredAndPredicted, { title })}
          xLabel={time}
          yLabel={reading.unit}
          summary={outputs.map((one, index) => describeFit(shown[index]?.run, one)).join(" ")}
          curves={[
            ...measuredCurves(first, read),
            ...outputs.flatMap((one, index) => predicted(shown[index]?.run, one, index, read)),
          ]}
        />
        <CurvePlot
          title={fillText(TEXTS.measuredMinusPredicted, { title })}
          xLabel={time}
          yLabel={reading.unit}
          summary={TEXTS.residualsSummary}
          curves={outputs.flatMap((one, index) => residuals(shown[index]?.run, one, index, read))}
        />
      </div>
    </section>
  );
}

function describeFit(run: number | undefined, output: UnseenOutput | undefined): string {
  if (output?.fit_percent === null || output === undefined)
    return fillText(TEXTS.noComparison, { run: run ?? "" });
  return fillText(TEXTS.fitOfRun, { run: run ?? "", fit: `${percent(output.fit_percent, 1)} %` });
}

type Read = (values: readonly number[]) => number[];

function measuredCurves(output: UnseenOutput, read: Read): Curve[] {
  return output.stretches.map((stretch, index) => ({
    label: TEXTS.measured,
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
    label: fillText(TEXTS.modelOfRun, { run: run ?? "" }),
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
    label: fillText(TEXTS.runLink, { run: run ?? "" }),
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

/** Shows one row for each candidate; each value has its difference from the first candidate below it. */
function Side({ name, title, shown, outputs, unit, factor }: SideProps) {
  const candidates = shown.map((one) => candidateOf(one, name));
  const first = candidates[0];
  if (first === null || first === undefined) return null;
  return (
    <Table withRowBorders={false} verticalSpacing={2} aria-label={fillText(TEXTS.comparedModels, { title })}>
      <Table.Thead>
        <Table.Tr>
          <Table.Th>{TEXTS.run}</Table.Th>
          {first.estimates.map((one) => (
            <Table.Th key={one.name} className={page.number}>
              <SignalName name={one.name} /> {one.unit !== "1" && `[${one.unit}]`}
            </Table.Th>
          ))}
          <Table.Th className={page.number}>
            <Explained of="quantity:fit_percent">{TEXTS.fit}</Explained> [%]
          </Table.Th>
          <Table.Th className={page.number}>{fillText(TEXTS.residualRms, { unit })}</Table.Th>
          <Table.Th>{TEXTS.grade}</Table.Th>
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
                          <Absent why={TEXTS.noStandardError} />
                        </>
                      )}
                    </span>
                    {index > 0 && (
                      <small className={styles.apart}>
                        {change(one.value, first.estimates[at]?.value ?? 0) ?? TEXTS.noChange}
                      </small>
                    )}
                  </Table.Td>
                ))}
                <Table.Td className={page.number}>
                  <ValueOrReason value={output?.fit_percent} why={output?.problem || TEXTS.computing}>
                    {(fit) => percent(fit, 2)}
                  </ValueOrReason>
                </Table.Td>
                <Table.Td className={page.number}>
                  <ValueOrReason value={output?.rms} why={output?.problem || TEXTS.computing}>
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
