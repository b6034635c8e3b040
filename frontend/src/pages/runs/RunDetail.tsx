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
import { capital, dateTime, duration, fixed, heading, measured, settingValue } from "../../samples/format";
import { formatWithUnit, readingOf, withUnit } from "../../samples/quantity";
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

/** What a run came to: verdict, criteria, figures; of an identification its own verdict. */

function RunResult({ run }: { run: Run }) {
  return (
    <Card
      title="Result"
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
  if (run.end_state === "running") return <span>The run is not over: there is no result yet.</span>;
  if (run.evaluation === "none") {
    return <span>Recorded by hand: no program was played, nothing is judged.</span>;
  }
  if (run.evaluation === "under_way" || evaluate.isPending) return <span>The result is being computed.</span>;
  if (run.evaluation === "done") {
    return run.kind.endsWith("_identification") ? <Identified id={run.id} /> : <Judged id={run.id} />;
  }
  return (
    <>
      <Verdict good={false}>Not evaluated: {unevaluated(run)}</Verdict>
      <OperatorsOnly>
        <div className={pageStyles.actions}>
          <Button variant="default" size="compact-sm" onClick={() => evaluate.mutate()}>
            Evaluate again
          </Button>
          <Refusal error={evaluate.error} />
        </div>
      </OperatorsOnly>
    </>
  );
}

function Judged({ id }: { id: number }) {
  const { data, error } = useQuery(experimentQuery(id));
  if (data === undefined) return <span>{error?.message ?? "Loading …"}</span>;
  return (
    <>
      <Outcome of={data} />
      <Figures criteria={data.criteria} metrics={data.metrics} />
    </>
  );
}

function Identified({ id }: { id: number }) {
  const { data, error } = useQuery(identificationQuery(id));
  if (data === undefined) return <span>{error?.message ?? "Loading …"}</span>;
  return (
    <>
      <Verdict good={data.usable}>{data.message}</Verdict>
      <Link href={`/identify/${id}`}>Models and fits of this identification</Link>
    </>
  );
}

/** Verdict and key figure of a run in a list. */

type JudgedRun = Pick<Run, "outcome" | "end_state">;

/** How a run counts; a kind of run without criteria is not judged. */
export function RunVerdict({ run: { outcome, end_state } }: { run: JudgedRun }) {
  const why = end_state === "running" ? "the run is not over" : "recorded by hand: nothing is judged";
  return (
    <ValueOrReason value={outcome} why={why}>
      {(found) =>
        found === "neutral" ? (
          <Explained of="outcome:neutral" quiet>
            Not judged
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

/** The figure that decided, with its bound; the first one measured where nothing is judged. */
export function KeyFigure({ headline }: Pick<Run, "headline">) {
  const angles = useAngleUnit();
  return (
    <ValueOrReason value={headline} why="no figure was measured">
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

/** What a person wants to remember of a run, and what can be taken away of it. */

export function NoteCard({ run }: { run: Run }) {
  const draft = useDraft(`note of run ${run.id}`, run.note, isText);
  const note = draft.value;
  const save = useSetNote(run.id);
  return (
    <Card title="Note and downloads">
      <RefusedFields error={save.error} about={note} only="note">
        <div className={pageStyles.fields}>
          <NoteField value={note} onChange={draft.set} />
          <DraftMark draft={draft} of="note" back="The saved note comes back." onDiscard={draft.discard} />
          <div className={pageStyles.actions}>
            <OperatorsOnly>
              <Button
                variant="default"
                disabled={note === run.note}
                loading={save.isPending}
                onClick={() => save.mutate(note, { onSuccess: draft.discard })}
              >
                Save note
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
      label="Note"
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

/** What a run was set to, with units. */

export function SettingsCard({ settings }: { settings: Run["settings"] }) {
  const angles = useAngleUnit();
  return (
    <Card title="Settings">
      {settings.length === 0 ? (
        <p className={pageStyles.empty}>No settings were stored with this run.</p>
      ) : (
        <div className={pageStyles.tableScroll}>
          <Table aria-label="Settings" verticalSpacing={2}>
            <Table.Thead>
              <Table.Tr>
                <Table.Th>Setting</Table.Th>
                <Table.Th>Symbol</Table.Th>
                <Table.Th className={pageStyles.number}>Value</Table.Th>
                <Table.Th>Unit</Table.Th>
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

/** The tags of a run: put on, taken off, and led on to the runs that have them too. */

function Tags({ run }: { run: Run }) {
  const draft = useDraft(`tag of run ${run.id}`, "", isText);
  const typed = draft.value;
  const change = useTag(run.id);
  const words = useQuery(searchWordsQuery);
  const known = useId();
  function put(): void {
    if (typed.trim() !== "") {
      change.mutate({ tag: typed.trim(), put: true }, { onSuccess: draft.discard });
    }
  }
  return (
    <div className={pageStyles.fields}>
      <ul className={runsStyles.tags} aria-label="Tags">
        {run.tags.length === 0 && <li className={pageStyles.dim}>no tags</li>}
        {run.tags.map((tag) => (
          <li key={tag} className={runsStyles.tag}>
            {tag}
            <OperatorsOnly>
              <ActionIcon
                size={16}
                variant="subtle"
                color="gray"
                aria-label={`Take off ${tag}`}
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
            put();
          }}
        >
          <TextInput
            aria-label="New tag"
            placeholder="New tag"
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
            Add tag
          </Button>
          <Refusal error={change.error} about={typed} />
        </form>
      </OperatorsOnly>
    </div>
  );
}

/** One run: when, by whom and its curves first, then what it came to, what it was and with which settings. */

interface RunDetailProps {
  readonly id: number;
  /** The second of the recording to be shown first; its begin where left out. */
  readonly at_s?: number | null;
  readonly others: readonly number[];
  /** How it is compared with these. */
  readonly compared?: Compared;
  /** What of the address could not be followed. */
  readonly problem?: string;
}

export function RunDetail({ id, at_s = null, others, compared = USUAL, problem = "" }: RunDetailProps) {
  const { data, error } = useQuery(runQuery(id));
  const together = [id, ...others].map((number) => `run ${number}`);
  return (
    <div className={pageStyles.page}>
      <h1 className={pageStyles.title}>
        <Link href="/runs">Runs</Link> / {others.length > 0 ? capital(together.join(", ")) : `Run ${id}`}
        {data && others.length === 0 && `: ${data.title}`}
      </h1>
      {problem !== "" && (
        <p className={pageStyles.lead} role="alert">
          {capital(problem)}.
        </p>
      )}
      {data === undefined && <p className={pageStyles.empty}>{error?.message ?? "Loading …"}</p>}
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
              <Card title="Curves" aside={<CompareWith run={data} others={others} />}>
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

/** Lines above the curves of a comparison: more of them would push the curves out of sight. */
const MOST_NAMED = 4;

/** One of several compared runs, by its kind. */
function NamedRun({ id }: { id: number }) {
  const { data } = useQuery(runQuery(id));
  return data === undefined ? null : <Made run={data} title={`Run ${id}: ${data.title}`} />;
}

/** When, by whom, on what, and what it came to: in a line below the title. */
function Made({ run, title }: { run: Run; title?: string }) {
  return (
    <p className={runsStyles.made}>
      {title !== undefined && <Link href={`/runs/${run.id}`}>{title}</Link>}
      <span>{dateTime(run.started)}</span>
      <span>{run.who}</span>
      <span>{duration(run.duration_s)}</span>
      <span>
        {run.plant}, parameters {run.parameters}
      </span>
      <RunState state={run.end_state} reason={run.end_reason} unevaluated={unevaluated(run)} />
      {run.outcome !== null && <RunVerdict run={run} />}
      {run.headline !== null && <KeyFigure headline={run.headline} />}
    </p>
  );
}

function Facts({ run }: { run: Run }) {
  return (
    <Card title={`Run ${run.id}`}>
      <dl className={pageStyles.facts}>
        <dt>Started</dt>
        <dd>
          {dateTime(run.started)} by {run.who}
        </dd>
        <dt>Length</dt>
        <dd>
          {duration(run.duration_s)}, {run.samples} samples
        </dd>
        <dt>Plant</dt>
        <dd>
          {run.plant}, parameters {run.parameters}
        </dd>
        {run.origin !== "" && (
          <>
            <dt>Origin</dt>
            <dd>{run.origin}</dd>
          </>
        )}
        {run.station !== "" && (
          <>
            <dt>Station</dt>
            <dd>{run.station}</dd>
          </>
        )}
        <dt>References</dt>
        <dd>
          <Link href={experimentOf(run.id)}>Make an experiment of this</Link>
        </dd>
        <dt>Tags</dt>
        <dd>
          <Tags run={run} />
        </dd>
        <dt>Ended</dt>
        <dd>
          {run.ended === null ? "still running" : dateTime(run.ended)}
          {run.end_reason !== "" && <LocalizedText text={`: ${run.end_reason}`} />}
        </dd>
        <dt>Completeness</dt>
        <dd>
          {run.missing_samples === null ? (
            "missing samples not known: the service died while it recorded"
          ) : (
            <Verdict good={run.missing_samples === 0}>
              {run.missing_samples === 0
                ? "no sample missing"
                : `${fixed(run.missing_samples, 0)} samples missing`}
            </Verdict>
          )}
          {run.samples_deleted !== null &&
            `; the samples were deleted ${dateTime(run.samples_deleted)} to make room`}
        </dd>
      </dl>
    </Card>
  );
}
