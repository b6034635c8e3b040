import { ActionIcon, Button, Table, Textarea, TextInput } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useId } from "react";
import { TbX } from "react-icons/tb";
import { Link } from "wouter";
import { Card } from "../../components/Card";
import { OperatorsOnly } from "../../components/ControlMenu";
import { Downloads } from "../../components/Downloads";
import { DraftMark } from "../../components/DraftMark";
import { Explained } from "../../components/Explained";
import { Refusal } from "../../components/Refusal";
import { Outcome, RunState, unevaluated, Verdict } from "../../components/RunState";
import { LocalizedText, Unit, ValueOrReason } from "../../components/values";
import { dateTime, duration, fixed, heading, measured, settingValue } from "../../samples/format";
import { formatWithUnit, readingOf, withUnit } from "../../samples/quantity";
import { fillText } from "../../samples/texts";
import { experimentQuery } from "../../service/api/experiments";
import { identificationQuery } from "../../service/api/identifications";
import { useAngleUnit } from "../../service/api/preferences";
import { runQuery, searchWordsQuery, useEvaluate, useSetNote, useTag } from "../../service/api/runs";
import { useMayCommand } from "../../service/control/control";
import { isText, useDraft } from "../../service/forms/drafts";
import { RefusedFields, useRefusedInput } from "../../service/forms/refusals";
import { entryOf, symbolEntry } from "../../service/glossary";
import type { Run } from "../../wire/types";
import { Figures } from "../experiments/ExperimentRuns";
import pageStyles from "../Page.module.css";
import { ComparedRuns, CompareWith } from "./ComparisonCard";
import { LineageCard } from "./LineageCard";
import { RunCharts } from "./RunCharts";
import runsStyles from "./Runs.module.css";
import { type Compared, experimentOf, USUAL } from "./runAddress";
import { TEXTS } from "./texts";

/** Card with the result of a run: verdict, criteria and metrics, or the verdict of an identification. */

function RunResult({ run }: { run: Run }) {
  return (
    <Card
      title={TEXTS.result}
      aside={<RunState state={run.end_state} reason={run.end_reason} unevaluated={unevaluated(run)} />}
    >
      <div className={pageStyles.fields}>
        <Evaluated run={run} />
      </div>
    </Card>
  );
}

function Evaluated({ run }: { run: Run }) {
  const evaluate = useEvaluate(run.id);
  if (run.end_state === "running") return <span>{TEXTS.noResultYet}</span>;
  if (run.evaluation === "none") {
    return <span>{TEXTS.manualSession}</span>;
  }
  if (run.evaluation === "under_way" || evaluate.isPending) return <span>{TEXTS.evaluating}</span>;
  if (run.evaluation === "done") {
    return run.kind.endsWith("_identification") ? <Identified id={run.id} /> : <Judged id={run.id} />;
  }
  return (
    <>
      <Verdict good={false}>{fillText(TEXTS.notEvaluated, { reason: unevaluated(run) ?? "" })}</Verdict>
      <OperatorsOnly>
        <div className={pageStyles.actions}>
          <Button variant="default" size="compact-sm" onClick={() => evaluate.mutate()}>
            {TEXTS.evaluateAgain}
          </Button>
          <Refusal error={evaluate.error} />
        </div>
      </OperatorsOnly>
    </>
  );
}

function Judged({ id }: { id: number }) {
  const { data, error } = useQuery(experimentQuery(id));
  if (data === undefined) return <span>{error?.message ?? TEXTS.loading}</span>;
  return (
    <>
      <Outcome of={data} />
      <Figures criteria={data.criteria} metrics={data.metrics} />
    </>
  );
}

function Identified({ id }: { id: number }) {
  const { data, error } = useQuery(identificationQuery(id));
  if (data === undefined) return <span>{error?.message ?? TEXTS.loading}</span>;
  return (
    <>
      <Verdict good={data.usable}>{data.message}</Verdict>
      <Link href={`/identify/${id}`}>{TEXTS.identifiedModels}</Link>
    </>
  );
}

/** Verdict and headline metric of a run in a list. */

type JudgedRun = Pick<Run, "outcome" | "end_state">;

/** Verdict of a run; runs without criteria are not judged. */
export function RunVerdict({ run: { outcome, end_state } }: { run: JudgedRun }) {
  const why = end_state === "running" ? TEXTS.notOver : TEXTS.noCriteria;
  return (
    <ValueOrReason value={outcome} why={why}>
      {(found) =>
        found === "neutral" ? (
          <Explained of="outcome:neutral" quiet>
            {TEXTS.notJudged}
          </Explained>
        ) : (
          <Verdict good={found === "passed"} of={`outcome:${found}`}>
            {heading(found)}
          </Verdict>
        )
      }
    </ValueOrReason>
  );
}

/** Headline metric: the deciding metric with its bound, or the first measured one without criteria. */
export function KeyFigure({ headline }: Pick<Run, "headline">) {
  const angles = useAngleUnit();
  return (
    <ValueOrReason value={headline} why={TEXTS.noMetric}>
      {({ name, label, value, unit, relation, bound }) => {
        const reading = readingOf(unit, angles);
        return (
          <span className={runsStyles.key}>
            <Explained of={entryOf(`figure:${name}`) ?? entryOf(`quantity:${name}`)}>{label}</Explained>
            <span className={runsStyles.keyValue}>
              {withUnit(measured(value * reading.factor, 3), reading.unit)}
            </span>
            {bound !== null && (
              <span className={runsStyles.bound}>
                {relation} {formatWithUnit(bound, unit, angles)}
              </span>
            )}
          </span>
        );
      }}
    </ValueOrReason>
  );
}

/** Card with the note of a run and its downloads. */

export function NoteCard({ run }: { run: Run }) {
  const draft = useDraft(`note of run ${run.id}`, run.note, isText);
  const note = draft.value;
  const save = useSetNote(run.id);
  return (
    <Card title={TEXTS.noteAndDownloads}>
      <RefusedFields error={save.error} about={note} only="note">
        <div className={pageStyles.fields}>
          <NoteField value={note} onChange={draft.set} />
          <DraftMark draft={draft} of={TEXTS.noteDraft} back={TEXTS.noteRestored} onDiscard={draft.discard} />
          <div className={pageStyles.actions}>
            <OperatorsOnly>
              <Button
                variant="default"
                disabled={note === run.note}
                loading={save.isPending}
                onClick={() => save.mutate(note, { onSuccess: draft.discard })}
              >
                {TEXTS.saveNote}
              </Button>
            </OperatorsOnly>
            <Refusal error={save.error} about={note} />
          </div>
          <div className={pageStyles.actions}>
            <Downloads run={run.id} report={run.end_state !== "running"} />
          </div>
        </div>
      </RefusedFields>
    </Card>
  );
}

function NoteField({ value, onChange }: { value: string; onChange: (value: string) => void }) {
  const { ref, said } = useRefusedInput<HTMLTextAreaElement>("note");
  return (
    <Textarea
      label={TEXTS.note}
      autosize
      minRows={2}
      maxRows={6}
      value={value}
      ref={ref}
      error={said}
      readOnly={useMayCommand() === false}
      onChange={(event) => onChange(event.currentTarget.value)}
    />
  );
}

/** Card with the settings of a run, with units. */

export function SettingsCard({ settings }: { settings: Run["settings"] }) {
  const angles = useAngleUnit();
  return (
    <Card title={TEXTS.settings}>
      {settings.length === 0 ? (
        <p className={pageStyles.empty}>{TEXTS.noSettings}</p>
      ) : (
        <div className={pageStyles.tableScroll}>
          <Table aria-label={TEXTS.settings} verticalSpacing={2}>
            <Table.Thead>
              <Table.Tr>
                <Table.Th>{TEXTS.setting}</Table.Th>
                <Table.Th>{TEXTS.symbol}</Table.Th>
                <Table.Th className={pageStyles.number}>{TEXTS.value}</Table.Th>
                <Table.Th>{TEXTS.unit}</Table.Th>
              </Table.Tr>
            </Table.Thead>
            <Table.Tbody>
              {settings.map(({ name, meaning, symbol, value, unit }) => (
                <Table.Tr key={name}>
                  <Table.Td>{meaning}</Table.Td>
                  <Table.Td>
                    <Explained of={symbolEntry(symbol) ?? symbolEntry(name)}>{symbol}</Explained>
                  </Table.Td>
                  <Table.Td className={pageStyles.number}>
                    {settingValue(typeof value === "number" ? value * readingOf(unit, angles).factor : value)}
                  </Table.Td>
                  <Table.Td>
                    <Unit unit={unit} />
                  </Table.Td>
                </Table.Tr>
              ))}
            </Table.Tbody>
          </Table>
        </div>
      )}
    </Card>
  );
}

/** Tags of a run; an operator can add and remove them. */

function Tags({ run }: { run: Run }) {
  const draft = useDraft(`tag of run ${run.id}`, "", isText);
  const typed = draft.value;
  const change = useTag(run.id);
  const words = useQuery(searchWordsQuery);
  const known = useId();
  function add(): void {
    if (typed.trim() !== "") {
      change.mutate({ tag: typed.trim(), put: true }, { onSuccess: draft.discard });
    }
  }
  return (
    <div className={pageStyles.fields}>
      <ul className={runsStyles.tags} aria-label={TEXTS.tags}>
        {run.tags.length === 0 && <li className={pageStyles.dim}>{TEXTS.noTags}</li>}
        {run.tags.map((tag) => (
          <li key={tag} className={runsStyles.tag}>
            {tag}
            <OperatorsOnly>
              <ActionIcon
                size={16}
                variant="subtle"
                color="gray"
                aria-label={fillText(TEXTS.removeTag, { tag })}
                onClick={() => change.mutate({ tag, put: false })}
              >
                <TbX size={11} />
              </ActionIcon>
            </OperatorsOnly>
          </li>
        ))}
      </ul>
      <OperatorsOnly>
        <form
          className={pageStyles.actions}
          onSubmit={(event) => {
            event.preventDefault();
            add();
          }}
        >
          <TextInput
            aria-label={TEXTS.newTag}
            placeholder={TEXTS.newTag}
            list={known}
            value={typed}
            w={160}
            onChange={(event) => draft.set(event.currentTarget.value)}
          />
          <datalist id={known}>
            {words.data?.tags.map((tag) => (
              <option key={tag} value={tag} />
            ))}
          </datalist>
          <Button type="submit" variant="default" disabled={typed.trim() === ""} loading={change.isPending}>
            {TEXTS.addTag}
          </Button>
          <Refusal error={change.error} about={typed} />
        </form>
      </OperatorsOnly>
    </div>
  );
}

/** Page of a run, or of a run compared with others: curves, result, facts, settings and lineage. */

interface RunDetailProps {
  readonly id: number;
  /** Time of the recording that is shown first; its start by default. */
  readonly at_s?: number | null;
  readonly others: readonly number[];
  /** Settings of the comparison with `others`. */
  readonly compared?: Compared;
  /** Text on invalid parts of the address. */
  readonly problem?: string;
}

export function RunDetail({ id, at_s = null, others, compared = USUAL, problem = "" }: RunDetailProps) {
  const { data, error } = useQuery(runQuery(id));
  return (
    <div className={pageStyles.page}>
      <h1 className={pageStyles.title}>
        <Link href="/runs">{TEXTS.runs}</Link> / {titleOf(id, others, data)}
      </h1>
      {problem !== "" && (
        <p className={pageStyles.lead} role="alert">
          {problem}.
        </p>
      )}
      {data === undefined && <p className={pageStyles.empty}>{error?.message ?? TEXTS.loading}</p>}
      {data && (
        <>
          {others.length > 0 ? (
            <>
              {[id, ...others].slice(0, MOST_NAMED).map((number) => (
                <NamedRun key={number} id={number} />
              ))}
              <ComparedRuns run={data} others={others} compared={compared} />
            </>
          ) : (
            <>
              <Made run={data} />
              <Card title={TEXTS.curves} aside={<CompareWith run={data} others={others} />}>
                <div className={pageStyles.charts}>
                  <RunCharts run={id} at_s={at_s} />
                </div>
              </Card>
            </>
          )}
          <div className={runsStyles.below}>
            <RunResult run={data} />
            <div className={pageStyles.column}>
              <Facts run={data} />
              <NoteCard run={data} />
            </div>
          </div>
          <SettingsCard settings={data.settings} />
          <LineageCard run={id} />
        </>
      )}
    </div>
  );
}

/** Returns the page title: the run, with its title once loaded, or the numbers of the compared runs. */
function titleOf(id: number, others: readonly number[], run: Run | undefined): string {
  if (others.length > 0) return fillText(TEXTS.severalRuns, { runs: [id, ...others].join(", ") });
  return run === undefined
    ? fillText(TEXTS.run, { run: id })
    : fillText(TEXTS.runWithTitle, { run: id, title: run.title });
}

/** Most lines above the curves of a comparison, so that the curves remain visible. */
const MOST_NAMED = 4;

/** Line of a compared run with its title. */
function NamedRun({ id }: { id: number }) {
  const { data } = useQuery(runQuery(id));
  return data === undefined ? null : (
    <Made run={data} title={fillText(TEXTS.runWithTitle, { run: id, title: data.title })} />
  );
}

/** Line below the title: date, person, duration, plant, status, verdict and headline metric. */
function Made({ run, title }: { run: Run; title?: string }) {
  return (
    <p className={runsStyles.made}>
      {title !== undefined && <Link href={`/runs/${run.id}`}>{title}</Link>}
      <span>{dateTime(run.started)}</span>
      <span>{run.who}</span>
      <span>{duration(run.duration_s)}</span>
      <span>{fillText(TEXTS.plantAndParameters, run)}</span>
      <RunState state={run.end_state} reason={run.end_reason} unevaluated={unevaluated(run)} />
      {run.outcome !== null && <RunVerdict run={run} />}
      {run.headline !== null && <KeyFigure headline={run.headline} />}
    </p>
  );
}

function Facts({ run }: { run: Run }) {
  return (
    <Card title={fillText(TEXTS.run, { run: run.id })}>
      <dl className={pageStyles.facts}>
        <dt>{TEXTS.started}</dt>
        <dd>{fillText(TEXTS.startedBy, { time: dateTime(run.started), person: run.who })}</dd>
        <dt>{TEXTS.duration}</dt>
        <dd>
          {fillText(TEXTS.durationAndSamples, {
            duration: duration(run.duration_s),
            samples: run.samples,
          })}
        </dd>
        <dt>{TEXTS.plant}</dt>
        <dd>{fillText(TEXTS.plantAndParameters, run)}</dd>
        {run.origin !== "" && (
          <>
            <dt>{TEXTS.origin}</dt>
            <dd>{run.origin}</dd>
          </>
        )}
        {run.station !== "" && (
          <>
            <dt>{TEXTS.station}</dt>
            <dd>{run.station}</dd>
          </>
        )}
        <dt>{TEXTS.references}</dt>
        <dd>
          <Link href={experimentOf(run.id)}>{TEXTS.createExperiment}</Link>
        </dd>
        <dt>{TEXTS.tags}</dt>
        <dd>
          <Tags run={run} />
        </dd>
        <dt>{TEXTS.ended}</dt>
        <dd>
          {run.ended === null ? TEXTS.inProgress : dateTime(run.ended)}
          {run.end_reason !== "" && <LocalizedText text={`: ${run.end_reason}`} />}
        </dd>
        <dt>{TEXTS.completeness}</dt>
        <dd>
          {run.missing_samples === null ? (
            TEXTS.missingUnknownWhy
          ) : (
            <Verdict good={run.missing_samples === 0}>
              {run.missing_samples === 0
                ? TEXTS.noneMissing
                : fillText(TEXTS.samplesMissing, { samples: fixed(run.missing_samples, 0) })}
            </Verdict>
          )}
          {run.samples_deleted !== null &&
            fillText(TEXTS.samplesDeleted, { time: dateTime(run.samples_deleted) })}
        </dd>
      </dl>
    </Card>
  );
}
