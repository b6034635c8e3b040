/** Page of identifications of actuator, motors and springs: start, results, and banks built from ticked runs. */

import { useQuery } from "@tanstack/react-query";
import { useState } from "react";
import { useLocation, useParams } from "wouter";
import { OperatorsOnly } from "../../components/ControlMenu";
import { identificationsQuery, springTablesQuery } from "../../service/api/identifications";
import { RunningCard } from "../operate/RunningCard";
import styles from "../Page.module.css";
import { type Forecast, IdentificationForm, PredictionView } from "./IdentificationForm";
import { BankBuilder, IdentificationList, IdentificationResult } from "./IdentificationList";
import { ParametersCard } from "./ParametersCard";
import { SpringTableList, SpringTableResult } from "./SpringResult";
import { TrendCard } from "./TrendCard";
import { TEXTS } from "./texts";
import { UnseenCard } from "./UnseenCard";

export default function IdentifyPage() {
  const { id } = useParams();
  const [, go] = useLocation();
  const identifications = useQuery(identificationsQuery);
  const [chosen, setChosen] = useState<ReadonlySet<number>>(new Set());
  const tables = useQuery(springTablesQuery);
  const [tableId, setTable] = useState<number | null>(null);
  const [forecast, setForecast] = useState<Forecast>({ prediction: undefined, problem: undefined });
  const table = tables.data?.find((item) => item.id === tableId);
  const newest = identifications.data?.[0]?.id;
  const selected = id === undefined ? newest : Number(id);
  const shown = identifications.data?.find(
    (one) => one.id === selected && one.estimate !== null && one.kind !== "spring",
  );

  function choose(number: number): void {
    const next = new Set(chosen);
    if (!next.delete(number)) next.add(number);
    setChosen(next);
  }

  return (
    <div className={styles.page}>
      <h1 className={styles.title}>{TEXTS.title}</h1>
      <RunningCard place="above" />
      <div className={styles.columns}>
        <div className={styles.column}>
          <OperatorsOnly otherwise={<p className={styles.empty}>{TEXTS.forOperators}</p>}>
            <IdentificationForm
              onStarted={(started) => {
                setTable(null);
                go(`/identify/${started}`);
              }}
              onTable={setTable}
              onForecast={setForecast}
            />
          </OperatorsOnly>
        </div>
        <div className={styles.column}>
          <RunningCard place="beside" />
          <OperatorsOnly>
            <PredictionView {...forecast} />
          </OperatorsOnly>
          <IdentificationList
            identifications={identifications.data}
            selected={selected}
            chosen={chosen}
            onChoose={choose}
            onShow={(run) => {
              setTable(null);
              go(`/identify/${run}`);
            }}
          />
          <OperatorsOnly>
            <BankBuilder chosen={chosen} onBuilt={() => setChosen(new Set())} />
          </OperatorsOnly>
          {table && <SpringTableResult key={table.id} table={table} />}
          {selected !== undefined && !table && <IdentificationResult key={selected} id={selected} />}
          {shown && (
            <UnseenCard key={`unseen ${shown.run}`} identification={shown} all={identifications.data ?? []} />
          )}
          <TrendCard identifications={identifications.data ?? []} />
          <div className={styles.halves}>
            <ParametersCard />
            <SpringTableList tables={tables.data ?? []} selected={tableId} onSelect={setTable} />
          </div>
        </div>
      </div>
    </div>
  );
}
