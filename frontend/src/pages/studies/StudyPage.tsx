import { Button, Progress, Table } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useState } from "react";
import { Link } from "wouter";
import { Card } from "../../components/Card";
import { OperatorsOnly } from "../../components/ControlMenu";
import { Explained } from "../../components/Explained";
import { Refusal } from "../../components/Refusal";
import { Unit, ValueOrReason } from "../../components/values";
import { capital, dateTime, duration, fixed, settingValue, short } from "../../samples/format";
import { readingOf } from "../../samples/quantity";
import { countThings, fillText } from "../../samples/texts";
import { useAngleUnit } from "../../service/api/preferences";
import {
  isUnderWay,
  type MapPick,
  studyQuery,
  useResumeStudy,
  useStopStudy,
} from "../../service/api/studies";
import { lastRefusal } from "../../service/forms/refusals";
import type { Study, StudyDetail, StudyFigure, StudyShare } from "../../wire/types";
import pageStyles from "../Page.module.css";
import { MapsCard } from "./MapsCard";
import studiesStyles from "./Studies.module.css";
import { TEXTS } from "./texts";

/** Progress of a study as text and as a bar. */

function StudyProgress({ study }: { study: Study }) {
  const { left_s } = study;
  const counts = { state: capital(study.state), done: fixed(study.done, 0), runs: fixed(study.points, 0) };
  return (
    <div className={studiesStyles.progress}>
      <Progress
        value={(100 * study.done) / study.points}
        aria-label={fillText(TEXTS.studyProgress, { id: study.id })}
        size="sm"
      />
      <span>
        {left_s === null
          ? fillText(TEXTS.doneOf, counts)
          : fillText(TEXTS.doneOfLeft, { ...counts, time: duration(left_s) })}
      </span>
    </div>
  );
}

/** Cards with the outcomes, the statistics of the metrics and the results of single runs. */

const STATISTICS = [
  ["least", TEXTS.columnLeast],
  ["p5", TEXTS.columnP5],
  ["median", TEXTS.columnMedian],
  ["mean", TEXTS.columnMean],
  ["p95", TEXTS.columnP95],
  ["largest", TEXTS.columnLargest],
  ["deviation", TEXTS.columnDeviation],
] as const;

export function SharesCard({ shares }: { shares: readonly StudyShare[] }) {
  return (
    <Card title={TEXTS.outcomes} aside={<span className={pageStyles.dim}>{TEXTS.outcomesHint}</span>}>
      <div className={pageStyles.tableScroll}>
        <Table aria-label={TEXTS.outcomes}>
          <Table.Thead>
            <Table.Tr>
              <Table.Th>{TEXTS.outcomeShare}</Table.Th>
              <Table.Th className={pageStyles.number}>{TEXTS.runs}</Table.Th>
              <Table.Th className={pageStyles.number}>{TEXTS.total}</Table.Th>
              <Table.Th className={pageStyles.number}>%</Table.Th>
              <Table.Th className={pageStyles.number}>{TEXTS.intervalPercent}</Table.Th>
              <Table.Th className={pageStyles.number}>{TEXTS.notEvaluated}</Table.Th>
            </Table.Tr>
          </Table.Thead>
          <Table.Tbody>
            {shares.map(({ name, label, count, of, left_out, percent, low, high }) => (
              <Table.Tr key={name}>
                <Table.Td>{label}</Table.Td>
                <Table.Td className={pageStyles.number}>{fixed(count, 0)}</Table.Td>
                <Table.Td className={pageStyles.number}>{fixed(of, 0)}</Table.Td>
                <Table.Td className={pageStyles.number}>
                  <ValueOrReason value={percent} why={TEXTS.noneEvaluated}>
                    {(known) => fixed(known, 1)}
                  </ValueOrReason>
                </Table.Td>
                <Table.Td className={pageStyles.number}>
                  <ValueOrReason
                    value={low === null || high === null ? null : ([low, high] as const)}
                    why={TEXTS.noneEvaluated}
                  >
                    {([low, high]) => fillText(TEXTS.interval, { low: fixed(low, 1), high: fixed(high, 1) })}
                  </ValueOrReason>
                </Table.Td>
                <Table.Td className={pageStyles.number}>{fixed(left_out, 0)}</Table.Td>
              </Table.Tr>
            ))}
          </Table.Tbody>
        </Table>
      </div>
    </Card>
  );
}

export function FiguresCard({ figures }: { figures: readonly StudyFigure[] }) {
  const angles = useAngleUnit();
  return (
    <Card title={TEXTS.metrics}>
      <div className={pageStyles.tableScroll}>
        <Table aria-label={TEXTS.metrics}>
          <Table.Thead>
            <Table.Tr>
              <Table.Th>{TEXTS.metric}</Table.Th>
              <Table.Th>{TEXTS.unit}</Table.Th>
              <Table.Th className={pageStyles.number}>{TEXTS.runs}</Table.Th>
              {STATISTICS.map(([which, label]) => (
                <Table.Th key={which} className={pageStyles.number}>
                  {label}
                </Table.Th>
              ))}
            </Table.Tr>
          </Table.Thead>
          <Table.Tbody>
            {figures.map((figure) => (
              <Table.Tr key={figure.name}>
                <Table.Td>
                  <Explained of={`figure:${figure.name}`}>{figure.label}</Explained>
                </Table.Td>
                <Table.Td>
                  <Unit unit={figure.unit} />
                </Table.Td>
                <Table.Td className={pageStyles.number}>
                  {figure.missing === 0
                    ? fixed(figure.count, 0)
                    : fillText(TEXTS.countOf, {
                        count: fixed(figure.count, 0),
                        total: fixed(figure.count + figure.missing, 0),
                      })}
                </Table.Td>
                {STATISTICS.map(([which]) => (
                  <Table.Td key={which} className={pageStyles.number}>
                    <ValueOrReason
                      value={figure[which]}
                      why={
                        figure.unstable > 0
                          ? fillText(TEXTS.unstableIn, { runs: countThings(figure.unstable, TEXTS.runCount) })
                          : TEXTS.oneRun
                      }
                    >
                      {(known) => short(known * readingOf(figure.unit, angles).factor)}
                    </ValueOrReason>
                  </Table.Td>
                ))}
              </Table.Tr>
            ))}
          </Table.Tbody>
        </Table>
      </div>
    </Card>
  );
}

function RowsCard({ detail }: { detail: StudyDetail }) {
  const { rows, study } = detail;
  const varied = Object.keys(rows[0]?.values ?? {});
  const symbols = new Map(detail.axes.map(({ name, symbol }) => [name, symbol]));
  const [shown, total] = [fixed(rows.length, 0), fixed(study.done, 0)];
  return (
    <Card
      title={TEXTS.results}
      aside={
        <span className={pageStyles.dim}>
          {rows.length < study.done ? fillText(TEXTS.firstResults, { shown, total }) : TEXTS.allResults}
        </span>
      }
    >
      <div className={pageStyles.tableScroll}>
        <Table aria-label={TEXTS.results}>
          <Table.Thead>
            <Table.Tr>
              <Table.Th className={pageStyles.number}>{TEXTS.run}</Table.Th>
              {varied.map((name) => (
                <Table.Th key={name} className={pageStyles.number}>
                  {symbols.get(name) ?? name}
                </Table.Th>
              ))}
              <Table.Th>{TEXTS.status}</Table.Th>
              <Table.Th>{TEXTS.criteria}</Table.Th>
            </Table.Tr>
          </Table.Thead>
          <Table.Tbody>
            {rows.map(({ number, values, state, detail: why, passed }) => (
              <Table.Tr key={number}>
                <Table.Td className={pageStyles.number}>{fixed(number, 0)}</Table.Td>
                {varied.map((name) => (
                  <Table.Td key={name} className={pageStyles.number}>
                    {settingValue(values[name] ?? "")}
                  </Table.Td>
                ))}
                <Table.Td title={why}>{state}</Table.Td>
                <Table.Td>
                  {passed === null
                    ? TEXTS.criteriaNotEvaluated
                    : passed
                      ? TEXTS.criteriaPassed
                      : TEXTS.criteriaFailed}
                </Table.Td>
              </Table.Tr>
            ))}
          </Table.Tbody>
        </Table>
      </div>
    </Card>
  );
}

/** Page of a study: progress, maps, outcomes, statistics and first results. */

export function StudyPage({ id }: { id: number }) {
  const [pick, setPick] = useState<MapPick>("worst");
  const { data, error } = useQuery(studyQuery(id, pick));
  return (
    <div className={pageStyles.page}>
      <h1 className={pageStyles.title}>
        <Link href="/studies">{TEXTS.title}</Link> / {fillText(TEXTS.studyLink, { id })}
      </h1>
      {data === undefined && (
        <p className={pageStyles.empty}>{error === null ? TEXTS.loading : error.message}</p>
      )}
      {data !== undefined && (
        <>
          <ProgressCard study={data.study} />
          {data.maps.length > 0 && <MapsCard detail={data} pick={pick} onPick={setPick} />}
          {data.study.done > 0 && <SharesCard shares={data.shares} />}
          {data.figures.length > 0 && <FiguresCard figures={data.figures} />}
          {data.rows.length > 0 && <RowsCard detail={data} />}
          <Card title={TEXTS.text}>
            <pre className={studiesStyles.text}>{data.text}</pre>
          </Card>
        </>
      )}
    </div>
  );
}

function ProgressCard({ study }: { study: Study }) {
  const stop = useStopStudy();
  const resume = useResumeStudy();
  const ends = Object.entries(study.ends).map(([end, count]) =>
    fillText(TEXTS.runsEnded, { runs: countThings(count, TEXTS.runCount), end }),
  );
  return (
    <Card title={study.title}>
      <div className={pageStyles.fields}>
        <StudyProgress study={study} />
        <p className={pageStyles.dim}>
          {[...ends, study.problem].filter((words) => words !== "").join("; ")}
        </p>
        <OperatorsOnly>
          <div className={pageStyles.actions}>
            <Button
              size="sm"
              variant="default"
              disabled={!isUnderWay(study)}
              loading={stop.isPending}
              onClick={() => stop.mutate(study.id)}
            >
              {TEXTS.stop}
            </Button>
            <Button
              size="sm"
              disabled={study.state !== "stopped"}
              loading={resume.isPending}
              onClick={() => resume.mutate(study.id)}
            >
              {TEXTS.resume}
            </Button>
          </div>
        </OperatorsOnly>
        <Refusal error={lastRefusal(stop, resume)} about={study.state} />
      </div>
    </Card>
  );
}

/** Table of studies with their progress and remaining time. */

export function StudyRows({ studies }: { studies: readonly Study[] }) {
  return (
    <div className={pageStyles.tableScroll}>
      <Table aria-label={TEXTS.title} highlightOnHover>
        <Table.Thead>
          <Table.Tr>
            <Table.Th>{TEXTS.study}</Table.Th>
            <Table.Th>{TEXTS.studyTitle}</Table.Th>
            <Table.Th>{TEXTS.created}</Table.Th>
            <Table.Th>{TEXTS.person}</Table.Th>
            <Table.Th>{TEXTS.progress}</Table.Th>
          </Table.Tr>
        </Table.Thead>
        <Table.Tbody>
          {studies.map((study) => (
            <Table.Tr key={study.id}>
              <Table.Td>
                <Link href={`/studies/${study.id}`}>{fillText(TEXTS.studyLink, { id: study.id })}</Link>
              </Table.Td>
              <Table.Td>{study.title}</Table.Td>
              <Table.Td style={{ whiteSpace: "nowrap" }}>{dateTime(study.created)}</Table.Td>
              <Table.Td>{study.who}</Table.Td>
              <Table.Td>
                <StudyProgress study={study} />
              </Table.Td>
            </Table.Tr>
          ))}
        </Table.Tbody>
      </Table>
    </div>
  );
}
