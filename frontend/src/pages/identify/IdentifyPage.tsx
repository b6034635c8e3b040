/** Launch an actuator identification, watch it, judge it, and build a bank from chosen ones. */

import { useQuery } from "@tanstack/react-query";
import { useState } from "react";
import { useLocation, useParams } from "wouter";
import { identificationsQuery } from "../../service/queries";
import styles from "../Page.module.css";
import { BankBuilder } from "./BankBuilder";
import { IdentificationForm } from "./IdentificationForm";
import { IdentificationList } from "./IdentificationList";
import { IdentificationResult } from "./IdentificationResult";

export default function IdentifyPage() {
  const { id } = useParams();
  const [, go] = useLocation();
  const identifications = useQuery(identificationsQuery);
  const [chosen, setChosen] = useState<ReadonlySet<number>>(new Set());
  const newest = identifications.data?.[0]?.id;
  const selected = id === undefined ? newest : Number(id);

  function choose(number: number): void {
    const next = new Set(chosen);
    if (!next.delete(number)) next.add(number);
    setChosen(next);
  }

  return (
    <div className={styles.page}>
      <h1 className={styles.title}>Identify</h1>
      <div className={styles.columns}>
        <div className={styles.column}>
          <IdentificationForm onStarted={(started) => go(`/identify/${started}`)} />
          <BankBuilder chosen={chosen} onBuilt={() => setChosen(new Set())} />
        </div>
        <div className={styles.column}>
          {selected !== undefined && <IdentificationResult key={selected} id={selected} />}
          <IdentificationList
            identifications={identifications.data}
            selected={selected}
            chosen={chosen}
            onChoose={choose}
          />
        </div>
      </div>
    </div>
  );
}
