import { Button, Progress, Table } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useState } from "react";
import { Link } from "wouter";
import { Card } from "../../components/Card";
import { OperatorsOnly } from "../../components/ControlMenu";
import { Explained } from "../../components/Explained";
import { Refusal } from "../../components/Refusal";
import { Unit, ValueOrReason } from "../../components/values";
import { capital, dateTime, duration, fixed, pluralized, settingValue, short } from "../../samples/format";
import { readingOf } from "../../samples/quantity";
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

/** How far a study is: in words, and as a bar. */

function StudyProgress({ study }: { study: Study }) {
  const left = study.left_s === null ? "" : `, ${duration(study.left_s)} left`;
  return (
    <div className={studiesStyles.progress}>
      <Progress
        value={(100 * study.done) / study.points}
        aria-label={`Progress of study ${study.id}`}
        size="sm"
      />
      <span>
        {capital(study.state)}, {fixed(study.done, 0)} of {fixed(study.points, 0)} runs{left}
      </span>
    </div>
  );
}

/** The figures of a study and how they are spread, and the rows that they come from. */

const STATISTICS = [
  ["least", "Least"],
  ["p5", "5 %"],
  ["median", "Median"],
  ["mean", "Mean"],
  ["p95", "95 %"],
  ["largest", "Largest"],
  ["deviation", "Std. dev."],
] as const;

export function SharesCard({ shares }: { shares: readonly StudyShare[] }) {
  return (
    <Card
      title="Runs"
      aside={<span className={pageStyles.dim}>with the 95 % confidence interval of each share</span>}
    >
      <div className={pageStyles.tableScroll}>
        <Table aria-label="Runs">
          <Table.Thead>
            <Table.Tr>
              <Table.Th>Share</Table.Th>
              <Table.Th className={pageStyles.number}>Runs</Table.Th>
              <Table.Th className={pageStyles.number}>Of</Table.Th>
              <Table.Th className={pageStyles.number}>%</Table.Th>
              <Table.Th className={pageStyles.number}>Interval [%]</Table.Th>
              <Table.Th className={pageStyles.number}>Not judged</Table.Th>
            </Table.Tr>
          </Table.Thead>
          <Table.Tbody>
            {shares.map(({ name, label, count, of, left_out, percent, low, high }) => (
              <Table.Tr key={name}>
                <Table.Td>{label}</Table.Td>
                <Table.Td className={pageStyles.number}>{fixed(count, 0)}</Table.Td>
                <Table.Td className={pageStyles.number}>{fixed(of, 0)}</Table.Td>
                <Table.Td className={pageStyles.number}>
                  <ValueOrReason value={percent} why="no run was judged">
                    {(known) => fixed(known, 1)}
                  </ValueOrReason>
                </Table.Td>
                <Table.Td className={pageStyles.number}>
                  <ValueOrReason
                    value={low === null || high === null ? null : [low, high]}
                    why="no run was judged"
                  >
                    {(known) => known.map((end) => fixed(end, 1)).join(" to ")}
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
    <Card title="Figures">
      <div className={pageStyles.tableScroll}>
        <Table aria-label="Figures">
          <Table.Thead>
            <Table.Tr>
              <Table.Th>Figure</Table.Th>
              <Table.Th>Unit</Table.Th>
              <Table.Th className={pageStyles.number}>Runs</Table.Th>
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
                  {fixed(figure.count, 0)}
                  {figure.missing > 0 && ` of ${fixed(figure.count + figure.missing, 0)}`}
                </Table.Td>
                {STATISTICS.map(([which]) => (
                  <Table.Td key={which} className={pageStyles.number}>
                    <ValueOrReason
                      value={figure[which]}
                      why={
                        figure.unstable > 0
                          ? `unstable loop in ${pluralized(figure.unstable, "run")}`
                          : "one run only"
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
  const first = `the first ${fixed(rows.length, 0)} of ${fixed(study.done, 0)}`;
  return (
    <Card
      title="Rows"
      aside={<span className={pageStyles.dim}>{rows.length < study.done ? first : "all"}, in SI units</span>}
    >
      <div className={pageStyles.tableScroll}>
        <Table aria-label="Rows">
          <Table.Thead>
            <Table.Tr>
              <Table.Th className={pageStyles.number}>Run</Table.Th>
              {varied.map((name) => (
                <Table.Th key={name} className={pageStyles.number}>
                  {symbols.get(name) ?? name}
                </Table.Th>
              ))}
              <Table.Th>End</Table.Th>
              <Table.Th>Criteria</Table.Th>
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
                <Table.Td>{passed === null ? "not judged" : passed ? "hold" : "do not hold"}</Table.Td>
              </Table.Tr>
            ))}
          </Table.Tbody>
        </Table>
      </div>
    </Card>
  );
}

/** One study: how far it is, its maps, how its figures are spread, its first rows. */

export function StudyPage({ id }: { id: number }) {
  const [pick, setPick] = useState<MapPick>("worst");
  const { data, error } = useQuery(studyQuery(id, pick));
  return (
    <div className={pageStyles.page}>
      <h1 className={pageStyles.title}>
        <Link href="/studies">Studies</Link> / Study {id}
      </h1>
      {data === undefined && (
        <p className={pageStyles.empty}>{error === null ? "Loading …" : error.message}</p>
      )}
      {data !== undefined && (
        <>
          <ProgressCard study={data.study} />
          {data.maps.length > 0 && <MapsCard detail={data} pick={pick} onPick={setPick} />}
          {data.study.done > 0 && <SharesCard shares={data.shares} />}
          {data.figures.length > 0 && <FiguresCard figures={data.figures} />}
          {data.rows.length > 0 && <RowsCard detail={data} />}
          <Card title="Text">
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
  const ends = Object.entries(study.ends).map(([end, count]) => `${pluralized(count, "run")} ${end}`);
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
              Stop study
            </Button>
            <Button
              size="sm"
              disabled={study.state !== "stopped"}
              loading={resume.isPending}
              onClick={() => resume.mutate(study.id)}
            >
              Resume
            </Button>
          </div>
        </OperatorsOnly>
        <Refusal error={lastRefusal(stop, resume)} about={study.state} />
      </div>
    </Card>
  );
}

/** Studies as a table: how far each is, and how long it takes on. */

export function StudyRows({ studies }: { studies: readonly Study[] }) {
  return (
    <div className={pageStyles.tableScroll}>
      <Table aria-label="Studies" highlightOnHover>
        <Table.Thead>
          <Table.Tr>
            <Table.Th>Study</Table.Th>
            <Table.Th>Title</Table.Th>
            <Table.Th>Begun</Table.Th>
            <Table.Th>Who</Table.Th>
            <Table.Th>Progress</Table.Th>
          </Table.Tr>
        </Table.Thead>
        <Table.Tbody>
          {studies.map((study) => (
            <Table.Tr key={study.id}>
              <Table.Td>
                <Link href={`/studies/${study.id}`}>Study {study.id}</Link>
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
