/** One study: how far it is, its maps, how its figures are spread, its first rows. */

import { Button } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useState } from "react";
import { Link } from "wouter";
import { Card } from "../../components/Card";
import { OperatorsOnly } from "../../components/OperatorsOnly";
import { Refusal } from "../../components/Refusal";
import { counted } from "../../samples/words";
import { lastRefusal } from "../../service/refusedFields";
import { isUnderWay, type MapPick, studyQuery, useResumeStudy, useStopStudy } from "../../service/studies";
import type { Study } from "../../wire/types";
import page from "../Page.module.css";
import { MapsCard } from "./MapsCard";
import styles from "./Studies.module.css";
import { StudyProgress } from "./StudyProgress";
import { FiguresCard, RowsCard, SharesCard } from "./StudyTables";

export function StudyPage({ id }: { id: number }) {
  const [pick, setPick] = useState<MapPick>("worst");
  const { data, error } = useQuery(studyQuery(id, pick));
  return (
    <div className={page.page}>
      <h1 className={page.title}>
        <Link href="/studies">Studies</Link> / Study {id}
      </h1>
      {data === undefined && <p className={page.empty}>{error === null ? "Loading …" : error.message}</p>}
      {data !== undefined && (
        <>
          <ProgressCard study={data.study} />
          {data.maps.length > 0 && <MapsCard detail={data} pick={pick} onPick={setPick} />}
          {data.study.done > 0 && <SharesCard shares={data.shares} />}
          {data.figures.length > 0 && <FiguresCard figures={data.figures} />}
          {data.rows.length > 0 && <RowsCard detail={data} />}
          <Card title="Text">
            <pre className={styles.text}>{data.text}</pre>
          </Card>
        </>
      )}
    </div>
  );
}

function ProgressCard({ study }: { study: Study }) {
  const stop = useStopStudy();
  const resume = useResumeStudy();
  const ends = Object.entries(study.ends).map(([end, count]) => `${counted(count, "run")} ${end}`);
  return (
    <Card title={study.title}>
      <div className={page.fields}>
        <StudyProgress study={study} />
        <p className={page.dim}>{[...ends, study.problem].filter((words) => words !== "").join("; ")}</p>
        <OperatorsOnly>
          <div className={page.actions}>
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
