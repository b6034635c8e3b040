import { Table } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { CurvePlot } from "../../charts/CurvePlot";
import { Explained } from "../../components/Explained";
import { Verdict } from "../../components/RunState";
import { SignalName, ValueOrReason } from "../../components/values";
import { useLive } from "../../live/react";
import { capital, describeStructure, fixed, percent, significant, spacedName } from "../../samples/format";
import { formatWithUnit, labelWith, readingOf, withUnit } from "../../samples/quantity";
import { fillText } from "../../samples/texts";
import { differenceInUseQuery } from "../../service/api/banks";
import { curvesQuery } from "../../service/api/identifications";
import { useAngleUnit } from "../../service/api/preferences";
import { tuningKey } from "../../service/api/tuning";
import { symbolEntry } from "../../service/glossary";
import { HUES } from "../../theme/signals";
import type { ChannelCurves, Correlation, Identification, Model, UnseenOutput } from "../../wire/types";
import { DifferenceTable } from "../banks/BankComparison";
import pageStyles from "../Page.module.css";
import identifyStyles from "./Identify.module.css";
import { TEXTS } from "./texts";

/** Largest number of runs in one report. */
const MOST_IN_A_REPORT = 100;

interface Estimated {
  /** Symbol in the notation. */
  readonly name: string;
  readonly unit: string;
  readonly value: number;
  readonly std: number | null;
}

interface Candidate {
  readonly run: number;
  readonly estimates: readonly Estimated[];
  readonly grade: string;
}

/** Returns the estimates of one output, "G_q" or "G_S" of an actuator, "A" or "B" of motors; null without any. */
export function candidateOf(identification: Identification, output: string): Candidate | null {
  const { run } = identification;
  const model = output === "G_q" ? identification.G_q : output === "G_S" ? identification.G_S : null;
  if (model !== null) {
    const unit = output === "G_S" ? "N·m/rad²" : "1";
    return {
      run,
      grade: model.grade,
      estimates: [
        { name: "K", unit, value: model.K, std: model.K_std },
        { name: "T", unit: "s", value: model.T, std: model.T_std },
      ],
    };
  }
  const motor = identification.motors.find(({ side }) => side === output);
  if (motor === undefined) return null;
  const { fitted, std_errors, u_c, u_c_std, grade } = motor;
  return {
    run,
    grade,
    estimates: [
      { name: "K_m", unit: "rad/(V·s)", value: fitted.K_m, std: std_errors.K_m },
      { name: "T_m", unit: "s", value: fitted.T_m, std: std_errors.T_m },
      { name: "u_c", unit: "V", value: u_c, std: u_c_std },
    ],
  };
}

/** Returns the identifications to compare with this one: others of its kind with a model, newest first. */
export function comparable(one: Identification, all: readonly Identification[]): Identification[] {
  return all.filter(({ run, kind, estimate }) => run !== one.run && kind === one.kind && estimate !== null);
}

/** Returns the runs with a model from the day of the newest one, oldest first. */
export function sessionOf(all: readonly Identification[]): number[] {
  const found = all.filter(({ estimate }) => estimate !== null);
  const day = (one: Identification) => new Date(one.created).toDateString();
  const newest = found[0];
  if (newest === undefined) return [];
  return found
    .filter((one) => day(one) === day(newest))
    .map(({ run }) => run)
    .slice(0, MOST_IN_A_REPORT)
    .reverse();
}

/** Formats the relative change of a value; null relative to zero. */
export function change(value: number, from: number): string | null {
  if (from === 0) return null;
  const percent = 100 * (value / from - 1);
  return `${percent > 0 ? "+" : ""}${fixed(percent, 1)} %`;
}

/** Describes the source of the predicted samples. */
export function describeRecord(kind: string, of: number, own: boolean): string {
  if (kind === "motor") return fillText(own ? TEXTS.ownSteps : TEXTS.otherSteps, { run: of });
  return fillText(own ? TEXTS.ownThird : TEXTS.otherThird, { run: of });
}

export function outputTitle(output: UnseenOutput): string {
  return output.name.startsWith("G_") ? output.name : fillText(TEXTS.motor, { side: output.name });
}

/** Describes the result of a residual test, with its statistic and level. */
export function residualOutcome(test: Correlation, good: string, bad: string): string {
  const { correlation, statistic, critical, level, passed } = test;
  return fillText(TEXTS.testOutcome, {
    outcome: passed ? good : bad,
    count: correlation.length,
    statistic: fixed(statistic, 1),
    bound: fixed(critical, 1),
    level: `${fixed(100 * level, 0)} %`,
  });
}

/** Shows one model: gain compared with geometry, lag, fit, parameters and verdict. */
function ModelView({
  name,
  path,
  unit,
  model,
  isExplained,
}: {
  name: string;
  path: string;
  unit: string;
  model: Model;
  /** Whether the verdict on the identification contains the reasons of this model's grade. */
  isExplained: boolean;
}) {
  const deviation = 100 * (model.K / model.gain_geometry - 1);
  const sign = deviation > 0 ? "+" : "";
  return (
    <section className={identifyStyles.model} aria-label={fillText(TEXTS.model, { name })}>
      <h3 className={identifyStyles.heading}>
        <SignalName name={name} /> <span className={pageStyles.dim}>{path}</span>
      </h3>
      <dl className={identifyStyles.figures}>
        <div>
          <dt>
            <Explained of="quantity:K">{TEXTS.gain}</Explained> {unit !== "" && `[${unit}]`}
          </dt>
          <dd>{significant(model.K, 4)}</dd>
          <dd className={identifyStyles.note}>
            {fillText(TEXTS.gainGeometry, {
              gain: significant(model.gain_geometry, 3),
              deviation: `${sign}${fixed(deviation, 1)} %`,
            })}
          </dd>
        </div>
        <div>
          <dt>
            <Explained of="quantity:T">{TEXTS.lags}</Explained> [s]
          </dt>
          <dd>{significant(model.T, 3)}</dd>
          <dd className={identifyStyles.note}>{TEXTS.firstOrderReduction}</dd>
        </div>
        <div>
          <dt>
            <Explained of="quantity:fit_percent">{TEXTS.fit}</Explained> [%]
          </dt>
          <dd>
            <ValueOrReason value={model.fit_percent} why={TEXTS.noValidationData}>
              {(fit) => percent(fit, 1)}
            </ValueOrReason>
          </dd>
          <dd className={identifyStyles.note}>{TEXTS.onValidationData}</dd>
        </div>
      </dl>
      <Table withRowBorders={false} verticalSpacing={2} aria-label={fillText(TEXTS.parametersOf, { name })}>
        <Table.Thead>
          <Table.Tr>
            <Table.Th>{describeStructure(model.structure)}</Table.Th>
            <Table.Th className={pageStyles.number}>{TEXTS.value}</Table.Th>
            <Table.Th className={pageStyles.number}>{TEXTS.standardError}</Table.Th>
          </Table.Tr>
        </Table.Thead>
        <Table.Tbody>
          {Object.entries(model.parameters).map(([parameter, value]) => (
            <Table.Tr key={parameter}>
              <Table.Td>
                <Explained of={symbolEntry(parameter)}>{parameter}</Explained>
              </Table.Td>
              <Table.Td className={pageStyles.number}>{significant(value, 4)}</Table.Td>
              <Table.Td className={pageStyles.number}>
                <ValueOrReason value={model.std_errors[parameter]} why={TEXTS.notDetermined}>
                  {(error) => significant(error, 2)}
                </ValueOrReason>
              </Table.Td>
            </Table.Tr>
          ))}
        </Table.Tbody>
      </Table>
      <span className={pageStyles.dim}>
        {fillText(TEXTS.estimatedBy, { method: spacedName(model.method) })}
      </span>
      <Verdict good={model.grade === "usable"} of={`grade:${model.grade}`}>
        {isExplained ? capital(model.grade) : model.verdict}
      </Verdict>
    </section>
  );
}

const COHERENT = 0.9;
const CHANNELS: Record<string, { hue: string; unit: string; output: string; outputUnit: string }> = {
  G_q: { hue: HUES.q, unit: "rad/rad", output: "q", outputUnit: "rad" },
  G_S: { hue: HUES.S, unit: "N·m/rad per rad", output: "S", outputUnit: "N·m/rad" },
};

/** Step of the drawn response [rad], a round value in the person's unit; the models are linear. */
const STEP = { deg: Math.PI / 18, rad: 1 } as const;

const UNKNOWN = { hue: "text", unit: "", output: "", outputUnit: "1" };

export function ActuatorResult({ identification }: { identification: Identification }) {
  const { G_q, G_S, run } = identification;
  const curves = useQuery(curvesQuery(run));
  return (
    <>
      <div className={pageStyles.halves}>
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
      <div className={pageStyles.halves}>
        {curves.data?.channels.map((channel) => (
          <Channel key={channel.name} channel={channel} />
        ))}
      </div>
      {curves.error && <p className={pageStyles.empty}>{curves.error.message}</p>}
      {identification.usable && <AgainstBankInUse run={run} />}
    </>
  );
}

const GRADES = ["usable", "usable with caution", "not usable"];

/** Whether the verdict on both models contains the reasons of this one: it contains those of the worse grade. */
function isWorst(model: Model, other: Model | null): boolean {
  return other === null || GRADES.indexOf(model.grade) >= GRADES.indexOf(other.grade);
}

function Channel({ channel }: { channel: ChannelCurves }) {
  const { hue, unit, output, outputUnit } = CHANNELS[channel.name] ?? UNKNOWN;
  const angles = useAngleUnit();
  const read = (value: number) => value * readingOf(outputUnit, angles).factor;
  const stepped = (value: number) => read(STEP[angles] * value);
  const { model, first_order, measured } = channel;
  const trusted = (values: readonly number[]) =>
    measured === null
      ? []
      : values.map((value, index) => ((measured.coherence[index] ?? 0) >= COHERENT ? value : null));
  const data = { label: TEXTS.coherentData, line: "none", points: true, colour: hue } as const;
  const reduced = { label: TEXTS.firstOrderCurve, colour: "limit", line: "dashed" } as const;
  const omega = "ω [rad/s]";
  return (
    <section className={identifyStyles.model} aria-label={fillText(TEXTS.curvesOf, { name: channel.name })}>
      <CurvePlot
        title={fillText(TEXTS.magnitudeOf, { name: channel.name })}
        xLabel={omega}
        yLabel={unit}
        xLog
        yLog
        summary={fillText(TEXTS.staticGain, {
          gain: withUnit(significant(model.magnitude[0] ?? Number.NaN, 3), unit),
        })}
        curves={[
          { ...data, x: measured?.omega ?? [], y: trusted(measured?.magnitude ?? []) },
          { label: TEXTS.modelCurve, colour: "text", x: model.omega, y: model.magnitude },
          { ...reduced, x: first_order.omega, y: first_order.magnitude },
        ]}
      />
      <CurvePlot
        title={fillText(TEXTS.phaseOf, { name: channel.name })}
        xLabel={omega}
        yLabel="deg"
        xLog
        height={150}
        summary={TEXTS.phaseSummary}
        curves={[
          { ...data, quiet: true, x: measured?.omega ?? [], y: trusted(measured?.phase_deg ?? []) },
          { label: TEXTS.modelCurve, quiet: true, colour: "text", x: model.omega, y: model.phase_deg },
          { ...reduced, quiet: true, x: first_order.omega, y: first_order.phase_deg },
        ]}
      />
      {measured && (
        <CurvePlot
          title={TEXTS.coherence}
          xLabel={omega}
          yLabel=""
          xLog
          height={110}
          summary={TEXTS.coherenceSummary}
          curves={[
            { label: TEXTS.coherence, quiet: true, colour: hue, x: measured.omega, y: measured.coherence },
          ]}
        />
      )}
      <CurvePlot
        title={fillText(TEXTS.stepOf, { step: formatWithUnit(STEP[angles], "rad", angles) })}
        xLabel="t [s]"
        yLabel={labelWith(output, outputUnit, angles)}
        height={150}
        summary={TEXTS.stepSummary}
        curves={[
          { label: TEXTS.modelCurve, colour: hue, x: channel.step_t, y: channel.step_model.map(stepped) },
          { ...reduced, x: channel.step_t, y: channel.step_first_order.map(stepped) },
        ]}
      />
      <Residuals
        title={TEXTS.autocorrelation}
        test={channel.whiteness}
        hue={hue}
        good={TEXTS.white}
        bad={TEXTS.notWhite}
      />
      <Residuals
        title={TEXTS.crossCorrelation}
        test={channel.input_correlation}
        hue={hue}
        good={TEXTS.uncorrelated}
        bad={TEXTS.correlated}
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
        xLabel={TEXTS.lag}
        yLabel={TEXTS.correlation}
        height={120}
        summary={outcome}
        curves={[
          { ...edge, label: TEXTS.testBound, y: bound },
          { ...edge, label: TEXTS.lowerBound, quiet: true, y: bound.map((value) => -value) },
          { label: TEXTS.correlation, quiet: true, colour: hue, points: true, x: lags_s, y: correlation },
        ]}
      />
      <Verdict good={test.passed}>{outcome}</Verdict>
    </div>
  );
}

function Candidates({ channel }: { channel: ChannelCurves }) {
  return (
    <div className={pageStyles.tableScroll} style={{ marginBottom: 0 }}>
      <Table
        withRowBorders={false}
        verticalSpacing={2}
        aria-label={fillText(TEXTS.structuresFor, { name: channel.name })}
      >
        <Table.Caption>{TEXTS.structuresTried}</Table.Caption>
        <Table.Thead>
          <Table.Tr>
            <Table.Th>{TEXTS.structure}</Table.Th>
            <Table.Th className={pageStyles.number}>K</Table.Th>
            <Table.Th className={pageStyles.number}>T [s]</Table.Th>
            <Table.Th className={pageStyles.number}>{TEXTS.fitPercent}</Table.Th>
            <Table.Th className={pageStyles.number}>BIC</Table.Th>
            <Table.Th>{TEXTS.grade}</Table.Th>
          </Table.Tr>
        </Table.Thead>
        <Table.Tbody>
          {channel.candidates.map((candidate) => (
            <Table.Tr key={candidate.structure}>
              <Table.Td>{describeStructure(candidate.structure)}</Table.Td>
              <CandidateValue
                value={candidate.K}
                problem={candidate.problem}
                format={(K) => significant(K, 4)}
              />
              <CandidateValue
                value={candidate.T}
                problem={candidate.problem}
                format={(T) => significant(T, 3)}
              />
              <CandidateValue
                value={candidate.fit_percent}
                problem={candidate.problem}
                format={(fit) => percent(fit, 1)}
              />
              <CandidateValue
                value={candidate.BIC}
                problem={candidate.problem}
                format={(BIC) => fixed(BIC, 0)}
              />
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

interface CandidateValueProps {
  readonly value: number | null;
  /** Reason why the structure has no model. */
  readonly problem: string;
  format(value: number): string;
}

function CandidateValue({ value, problem, format }: CandidateValueProps) {
  return (
    <Table.Td className={pageStyles.number}>
      <ValueOrReason value={value} why={problem === "" ? TEXTS.notDetermined : problem}>
        {format}
      </ValueOrReason>
    </Table.Td>
  );
}

function AgainstBankInUse({ run }: { run: number }) {
  const lambdas = useLive((live) => tuningKey(live.state?.tuning));
  const difference = useQuery(differenceInUseQuery(run, lambdas));
  return (
    <section aria-label={TEXTS.againstActive}>
      <h3 className={identifyStyles.heading}>{TEXTS.effect}</h3>
      {difference.error && <p className={pageStyles.empty}>{difference.error.message}</p>}
      {difference.isPending && <p className={pageStyles.empty}>{TEXTS.comparing}</p>}
      {difference.data && <DifferenceTable difference={difference.data} />}
    </section>
  );
}
