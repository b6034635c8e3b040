/** One run: what it was, what it left, its curves. */

import { Button, Textarea } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useState } from "react";
import { Link } from "wouter";
import { Card } from "../../components/Card";
import { Downloads } from "../../components/Downloads";
import { Refusal } from "../../components/Refusal";
import { RunState, unevaluated } from "../../components/RunState";
import { Verdict } from "../../components/Verdict";
import { dateTime, duration, fixed } from "../../samples/format";
import { useEvaluate, useSetNote } from "../../service/commands";
import { runQuery } from "../../service/queries";
import type { Run } from "../../wire/types";
import page from "../Page.module.css";
import { CompareWith } from "./CompareWith";
import { LineageCard } from "./LineageCard";
import { RunCharts } from "./RunCharts";

const WITH_REPORT = new Set(["tracking", "compliance"]);

export function RunDetail({ id, other }: { id: number; other: number | undefined }) {
  const { data, error } = useQuery(runQuery(id));
  return (
    <div className={page.page}>
      <h1 className={page.title}>
        <Link href="/runs">Runs</Link> / Run {id}
      </h1>
      {data === undefined && <p className={page.empty}>{error?.message ?? "Loading …"}</p>}
      {data && (
        <>
          <div className={page.halves}>
            <Facts run={data} />
            <NoteCard run={data} />
          </div>
          <LineageCard run={id} />
          <Card title="Curves" aside={<CompareWith run={data} other={other} />}>
            <div className={page.charts}>
              <RunCharts run={id} other={other} />
            </div>
          </Card>
        </>
      )}
    </div>
  );
}

function Facts({ run }: { run: Run }) {
  return (
    <Card
      title={run.kind.replaceAll("_", " ")}
      aside={<RunState state={run.end_state} reason={run.end_reason} unevaluated={unevaluated(run)} />}
    >
      <dl className={page.facts}>
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
        <dt>Ended</dt>
        <dd>
          {run.ended === null ? "still running" : dateTime(run.ended)}
          {run.end_reason !== "" && `: ${run.end_reason}`}
        </dd>
        <dt>Result</dt>
        <dd>
          <Result run={run} />
        </dd>
        <dt>Completeness</dt>
        <dd>
          <Verdict good={run.missing_samples === 0}>
            {run.missing_samples === 0
              ? "no sample missing"
              : `${fixed(run.missing_samples, 0)} samples missing`}
          </Verdict>
          {run.samples_deleted !== null &&
            `; the samples were deleted ${dateTime(run.samples_deleted)} to make room`}
        </dd>
        <dt>Settings</dt>
        <dd>{settingsText(run.settings)}</dd>
      </dl>
    </Card>
  );
}

function Result({ run }: { run: Run }) {
  const evaluate = useEvaluate(run.id);
  if (run.evaluation === "none") return <>none to be had</>;
  if (run.evaluation === "under_way" || evaluate.isPending) return <>being computed</>;
  if (run.evaluation === "done") return <>computed</>;
  return (
    <>
      not evaluated: {unevaluated(run)}
      <div className={page.actions}>
        <Button variant="default" size="compact-sm" onClick={() => evaluate.mutate()}>
          Evaluate again
        </Button>
        <Refusal text={evaluate.error?.message} />
      </div>
    </>
  );
}

function NoteCard({ run }: { run: Run }) {
  const [note, setNote] = useState(run.note);
  const save = useSetNote(run.id);
  return (
    <Card title="Note and downloads">
      <div className={page.fields}>
        <Textarea
          label="Note"
          autosize
          minRows={2}
          maxRows={6}
          value={note}
          onChange={(event) => setNote(event.currentTarget.value)}
        />
        <div className={page.actions}>
          <Button
            variant="default"
            disabled={note === run.note}
            loading={save.isPending}
            onClick={() => save.mutate(note)}
          >
            Save note
          </Button>
          <Refusal text={save.error?.message} />
        </div>
        <div className={page.actions}>
          <Downloads run={run.id} report={WITH_REPORT.has(run.kind)} />
        </div>
      </div>
    </Card>
  );
}

function settingsText(settings: Run["settings"]): string {
  const parts = Object.entries(settings).map(([name, value]) => `${name} ${plain(value)}`);
  return parts.length === 0 ? "defaults" : parts.join(", ");
}

function plain(value: unknown): string {
  return typeof value === "object" && value !== null ? JSON.stringify(value) : String(value);
}
