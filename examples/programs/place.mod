MODULE Place
  ! Where the part is put down, and a speed of our own.
  CONST robtarget beside:=[[-600,-350,550],[0,1,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST jointtarget home:=[[17,-85,88,-93,-90,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST speeddata careful:=[40,500,5000,1000];
  PROC main()
    MoveAbsJ home,v100,fine,tool0;
    MoveL beside,v200,z10,tool0;
    MoveL Offs(beside,0,0,-80),careful,fine,tool0\WObj:=wobj0;
    SetDO doGrip,0;
    MoveL Offs(beside,0,0,80),v1000\V:=150,fine,tool0;
    MoveAbsJ home,[50,500,5000,1000],fine,tool0;
  ENDPROC
ENDMODULE
