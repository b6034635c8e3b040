/** G_q and G_S: models, responses beside the data, residual tests, candidates, and what would change in the bank. */

import { Table } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { CurvePlot } from "../../charts/CurvePlot";
import { Shown } from "../../components/Absent";
import { Explained } from "../../components/Explained";
import { Verdict } from "../../components/Verdict";
import { useLive } from "../../live/react";
import { fixed, percent, significant } from "../../samples/format";
import { labelWith, readingOf, told } from "../../samples/quantity";
import { structureInWords } from "../../samples/words";
import { useAngles } from "../../service/angles";
import { curvesQuery, differenceInUseQuery, tuningKey } from "../../service/queries";
import { HUES } from "../../theme/signals";
import type { ChannelCurves, Correlation, Identification, Model } from "../../wire/types";
import { DifferenceTable } from "../banks/DifferenceTable";
import page from "../Page.module.css";
import styles from "./Identify.module.css";
import { ModelView } from "./ModelView";
import { residualOutcome } from "./residuals";

const COHERENT = 0.9;
const CHANNELS: Record<string, { hue: string; unit: string; output: string; outputUnit: string }> = {
  G_q: { hue: HUES.q, unit: "rad/rad", output: "q", outputUnit: "rad" },
  G_S: { hue: HUES.S, unit: "N·m/rad per rad", output: "S", outputUnit: "N·m/rad" },
};

/** The step whose response is drawn, round as it is read; the models are linear [rad]. */
const STEP = { deg: Math.PI / 18, rad: 1 } as const;

const UNKNOWN = { hue: "text", unit: "", output: "", outputUnit: "1" };

export function ActuatorResult({ identification }: { identification: Identification }) {
  const { G_q, G_S, run } = identification;
  const curves = useQuery(curvesQuery(run));
  return (
    <>
      <div className={page.halves}>
        {G_q && (
          <ModelView name="G_q" path="θ_A,ref → q" unit="" model={G_q} isExplained={isWorst(G_q, G_S)} />
        )}
        {G_S && (
          <ModelView
            name="G_S"
            path="θ_A,ref → S"
            unit="N·m/rad²"
            model={G_S}
            isExplained={isWorst(G_S, G_q)}
          />
        )}
      </div>
      <div className={page.halves}>
        {curves.data?.channels.map((channel) => (
          <Channel key={channel.name} channel={channel} />
        ))}
      </div>
      {curves.error && <p className={page.empty}>{curves.error.message}</p>}
      {identification.usable && <AgainstBankInUse run={run} />}
    </>
  );
}

const GRADES = ["usable", "usable with caution", "not usable"];

/** Whether the verdict on both models has the reasons of this one: it has those of the worse grade. */
function isWorst(model: Model, other: Model | null): boolean {
  return other === null || GRADES.indexOf(model.grade) >= GRADES.indexOf(other.grade);
}

function Channel({ channel }: { channel: ChannelCurves }) {
  const { hue, unit, output, outputUnit } = CHANNELS[channel.name] ?? UNKNOWN;
  const angles = useAngles();
  const read = (value: number) => value * readingOf(outputUnit, angles).factor;
  const stepped = (value: number) => read(STEP[angles] * value);
  const { model, first_order, measured } = channel;
  const trusted = (values: readonly number[]) =>
    measured === null
      ? []
      : values.map((value, index) => ((measured.coherence[index] ?? 0) >= COHERENT ? value : null));
  const data = { label: "data, coherence above 0.9", line: "none", points: true, colour: hue } as const;
  const reduced = { label: "first order", colour: "limit", line: "dashed" } as const;
  const omega = "ω [rad/s]";
  return (
    <section className={styles.model} aria-label={`Curves of ${channel.name}`}>
      <CurvePlot
        title={`Magnitude of ${channel.name}`}
        xLabel={omega}
        yLabel={unit}
        xLog
        yLog
        summary={`Static gain ${significant(model.magnitude[0] ?? Number.NaN, 3)} ${unit}.`}
        curves={[
          { ...data, x: measured?.omega ?? [], y: trusted(measured?.magnitude ?? []) },
          { label: "model", colour: "text", x: model.omega, y: model.magnitude },
          { ...reduced, x: first_order.omega, y: first_order.magnitude },
        ]}
      />
      <CurvePlot
        title={`Phase of ${channel.name}`}
        xLabel={omega}
        yLabel="deg"
        xLog
        height={150}
        summary="Phase of model, data and first-order reduction."
        curves={[
          { ...data, quiet: true, x: measured?.omega ?? [], y: trusted(measured?.phase_deg ?? []) },
          { label: "model", quiet: true, colour: "text", x: model.omega, y: model.phase_deg },
          { ...reduced, quiet: true, x: first_order.omega, y: first_order.phase_deg },
        ]}
      />
      {measured && (
        <CurvePlot
          title="Coherence"
          xLabel={omega}
          yLabel=""
          xLog
          height={110}
          summary="How much of the output follows the input, by frequency."
          curves={[
            { label: "coherence", quiet: true, colour: hue, x: measured.omega, y: measured.coherence },
          ]}
        />
      )}
      <CurvePlot
        title={`Step of θ_A by ${told(STEP[angles], "rad", angles)}`}
        xLabel="t [s]"
        yLabel={labelWith(output, outputUnit, angles)}
        height={150}
        summary="Step response of the model and of its first-order reduction."
        curves={[
          { label: "model", colour: hue, x: channel.step_t, y: channel.step_model.map(stepped) },
          { ...reduced, x: channel.step_t, y: channel.step_first_order.map(stepped) },
        ]}
      />
      <Residuals
        title="Residual with itself"
        test={channel.whiteness}
        hue={hue}
        good="white"
        bad="not white: it follows a pattern that the model does not have"
      />
      <Residuals
        title="Residual with input"
        test={channel.input_correlation}
        hue={hue}
        good="free of the input"
        bad="depends on the input"
      />
      <Candidates channel={channel} />
    </section>
  );
}

interface ResidualsProps {
  readonly title: string;
  readonly test: Correlation;
  readonly hue: string;
  readonly good: string;
  readonly bad: string;
}

function Residuals({ title, test, hue, good, bad }: ResidualsProps) {
  const { lags_s, correlation, bound } = test;
  const edge = { colour: "limit", line: "dashed", x: lags_s } as const;
  const outcome = residualOutcome(test, good, bad);
  return (
    <div>
      <CurvePlot
        title={title}
        xLabel="lag [s]"
        yLabel="correlation"
        height={120}
        summary={outcome}
        curves={[
          { ...edge, label: "bound of the test", y: bound },
          { ...edge, label: "bound below", quiet: true, y: bound.map((value) => -value) },
          { label: "correlation", quiet: true, colour: hue, points: true, x: lags_s, y: correlation },
        ]}
      />
      <Verdict good={test.passed}>{outcome}</Verdict>
    </div>
  );
}

function Candidates({ channel }: { channel: ChannelCurves }) {
  return (
    <div className={page.tableScroll} style={{ marginBottom: 0 }}>
      <Table withRowBorders={false} verticalSpacing={2} aria-label={`Candidates for ${channel.name}`}>
        <Table.Caption>Structures tried on the same record, best first</Table.Caption>
        <Table.Thead>
          <Table.Tr>
            <Table.Th>Structure</Table.Th>
            <Table.Th className={page.number}>K</Table.Th>
            <Table.Th className={page.number}>T [s]</Table.Th>
            <Table.Th className={page.number}>Fit [%]</Table.Th>
            <Table.Th className={page.number}>BIC</Table.Th>
            <Table.Th>Grade</Table.Th>
          </Table.Tr>
        </Table.Thead>
        <Table.Tbody>
          {channel.candidates.map((candidate) => (
            <Table.Tr key={candidate.structure}>
              <Table.Td>{structureInWords(candidate.structure)}</Table.Td>
              <Tried value={candidate.K} problem={candidate.problem} told={(K) => significant(K, 4)} />
              <Tried value={candidate.T} problem={candidate.problem} told={(T) => significant(T, 3)} />
              <Tried
                value={candidate.fit_percent}
                problem={candidate.problem}
                told={(fit) => percent(fit, 1)}
              />
              <Tried value={candidate.BIC} problem={candidate.problem} told={(BIC) => fixed(BIC, 0)} />
              <Table.Td>
                {candidate.problem === "" ? (
                  <Explained of={`grade:${candidate.grade}`} quiet>
                    {candidate.grade}
                  </Explained>
                ) : (
                  candidate.problem
                )}
              </Table.Td>
            </Table.Tr>
          ))}
        </Table.Tbody>
      </Table>
    </div>
  );
}

interface TriedProps {
  readonly value: number | null;
  /** Why nothing came of the structure. */
  readonly problem: string;
  told(value: number): string;
}

function Tried({ value, problem, told }: TriedProps) {
  return (
    <Table.Td className={page.number}>
      <Shown value={value} why={problem === "" ? "not determined by this record" : problem}>
        {told}
      </Shown>
    </Table.Td>
  );
}

function AgainstBankInUse({ run }: { run: number }) {
  const lambdas = useLive((live) => tuningKey(live.state?.tuning));
  const difference = useQuery(differenceInUseQuery(run, lambdas));
  return (
    <section aria-label="Against the models in use">
      <h3 className={styles.heading}>What using this model would change</h3>
      {difference.error && <p className={page.empty}>{difference.error.message}</p>}
      {difference.isPending && <p className={page.empty}>Comparing …</p>}
      {difference.data && <DifferenceTable difference={difference.data} />}
    </section>
  );
}
